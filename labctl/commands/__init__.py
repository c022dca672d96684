"""The commands, one file per group: each reads its options, calls the library, and shows what came out."""

COMMANDS = {
    "demo": "labctl.commands.demo:demo",
    "reproduce": "labctl.commands.reproduce:reproduce",
    "init": "labctl.commands.init:init",
    "check": "labctl.commands.check:check",
    "align": "labctl.commands.align:align",
    "live": "labctl.commands.live:live",
    "run": "labctl.commands.run:run",
    "sweep": "labctl.commands.sweep:sweep",
    "queue": "labctl.commands.queue:app",
    "resume": "labctl.commands.resume:resume",
    "pause": "labctl.commands.control:pause",
    "go-on": "labctl.commands.control:go_on",
    "stop": "labctl.commands.control:stop",
    "dark": "labctl.commands.control:dark",
    "verify": "labctl.commands.verify:verify",
    "runs": "labctl.commands.runs:runs",
    "note": "labctl.commands.note:note",
    "show": "labctl.commands.show:show",
    "compare": "labctl.commands.compare:compare",
    "export": "labctl.commands.export:export",
    "publish": "labctl.commands.publish:publish",
    "train": "labctl.commands.train:train",
    "evaluate": "labctl.commands.evaluate:evaluate",
    "report": "labctl.commands.report:report",
    "dashboard": "labctl.commands.dashboard:app",
    "record": "labctl.commands.recording:record",
    "replay": "labctl.commands.recording:replay",
    "data": "labctl.commands.data:app",
    "sim": "labctl.commands.sim:app",
    "schema": "labctl.commands.schema:schema",
    "drivers": "labctl.commands.drivers:drivers",
    "doctor": "labctl.commands.doctor:doctor",
}
"""Name -> where it is, in the order of `labctl --help`: a function, or `app` for a module of commands.

A module is imported when its command is asked for. The line that the help shows is the first of the function's
docstring, or of the module's for an `app`; it is read from the source.
"""
