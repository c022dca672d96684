"""What git checks out has the same bytes on every system: digests of sources and of data are taken of them."""

import shutil
from pathlib import Path
from subprocess import run

import pytest

from tests.checkout import ROOT, files_below


@pytest.mark.skipif(shutil.which("git") is None, reason="there is no git")
def test_where_git_gives_windows_line_ends_it_changes_no_file(tmp_path: Path) -> None:
    kept = [path for folder in ("labctl", "data", "docs", "tests") for path in files_below(ROOT / folder)]
    kept = [path.relative_to(ROOT) for path in (ROOT / ".gitattributes", *kept) if path.suffix != ".pyc"]
    for path in kept:
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / path, tmp_path / path)
    windows = ("git", "-c", "core.autocrlf=true")
    run([*windows, "init", "--quiet"], check=True, cwd=tmp_path)
    run([*windows, "add", "--all", "--force"], check=True, cwd=tmp_path, capture_output=True)
    run([*windows, "checkout-index", "--all", "--prefix=there/"], check=True, cwd=tmp_path)
    assert {"labctl/__init__.py", "data/mnist-0-3/0.bin"} <= {path.as_posix() for path in kept}
    differ = [path for path in kept if (tmp_path / "there" / path).read_bytes() != (ROOT / path).read_bytes()]
    assert differ == []
