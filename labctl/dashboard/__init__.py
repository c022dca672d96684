"""The dashboard: a local web page about running and past runs.

It reads run directories and the events in them, and asks a run for a pause or its end through them; it never opens an
instrument. `serving` is the way in, `guard` who may come in, `pages` what they see.
"""
