"""From a station file to an opened, supervised bench."""
