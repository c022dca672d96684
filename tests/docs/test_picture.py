"""The picture in the README is what the demonstration draws: `make picture` draws it anew."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageChops

from labctl.commands.main import main
from tests.checkout import ROOT

KEPT = ROOT / "docs" / "accuracy.png"
VISIBLE = 25
"""Grey levels."""
MOVED = 0.02
"""Part of the pixels that differ visibly when every point of both curves has moved by half a point of accuracy."""


@pytest.mark.full
@pytest.mark.timeout(900)
def test_the_picture_of_the_readme_is_of_this_version(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["demo", "--out", str(tmp_path), "--json"])
    drawn = Path(json.loads(capsys.readouterr().out)["run"], "figures", "accuracy.png")
    with Image.open(drawn) as here, Image.open(KEPT) as kept:
        difference = np.asarray(ImageChops.difference(here.convert("RGB"), kept.convert("RGB")))
    assert np.mean(difference.max(axis=2) > VISIBLE) < MOVED
