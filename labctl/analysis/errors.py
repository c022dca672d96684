"""The one error of the analysis."""


class AnalysisError(ValueError):
    """Data and settings of an analysis do not fit together; the text says what to do, in one line."""
