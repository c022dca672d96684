"""The one error of the data sets."""


class DatasetError(Exception):
    """A data set is missing, damaged or asked for something it does not hold; the text says what to do, in one line."""
