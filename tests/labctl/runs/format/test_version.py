from pathlib import Path

import pytest

from labctl.errors import RunError
from labctl.runs.format.version import check_version


@pytest.mark.parametrize("version", ["1.0", "1.7", "1.12"])
def test_later_minor_versions_are_read(version: str) -> None:
    check_version(version, Path("data.h5"))


@pytest.mark.parametrize("version", ["2.0", "0.9", "new", "", "\n.1", "9" * 5000 + ".1"])
def test_other_versions_are_refused_in_one_line(version: str) -> None:
    with pytest.raises(RunError, match=r"^data\.h5: format .*reads 1\.x") as refused:
        check_version(version, Path("data.h5"))
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 200
