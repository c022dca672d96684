"""The run on disk: what was requested, what was measured, and proof that nothing is missing.

`format` defines the files, `write` makes them, `read` reads them, `live` reports on a run and controls it while it goes
on, `export` writes it for other programs. `index` lists runs, `verification` checks one.
Every failure a person can meet is a `RunError` of one line.
"""
