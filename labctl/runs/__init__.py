"""The run on disk: what was asked, what was measured, and proof that nothing is missing.

`format` says what the files hold, `write` makes them, `read` gives them back, `live` is what can be told of a run and
asked of it while it goes on, `export` writes it for other programs. `index` lists runs, `verification` checks one.
Every failure a person can meet is a `RunError` of one line.
"""
