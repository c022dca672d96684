"""Analysis of records: features, readouts, evaluation. It sees arrays and files only, wherever they come from."""

from labctl.errors import AnalysisError

__all__ = ["AnalysisError"]
