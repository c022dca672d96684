"""What the process of a command ends in; an error says for itself which it is (`LabctlError.exit_status`)."""

DONE, FELL_SHORT, WRONG_USE, INTERRUPTED = 0, 1, 2, 130
