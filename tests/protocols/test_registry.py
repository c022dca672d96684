"""Protocols by name and by file."""

from pathlib import Path

import pytest

from protocols.base import Judgement, ProtocolError
from protocols.image_readout import ImageReadout
from protocols.registry import GROUP, judgement_of, protocol_names, read_protocol


def test_by_name_with_settings() -> None:
    assert read_protocol("image-readout", ["images=40", "window=1 ns", "ports=2,3"]) == ImageReadout(
        images=40, window=1e-9, ports=(2, 3)
    )


def test_the_command_line_wins_over_the_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('protocol = "image-readout"\n[settings]\nimages = 40\nwindow = "1 ns"\n', encoding="utf-8")
    assert read_protocol(str(path), ["images=80"]) == ImageReadout(images=80, window=1e-9)


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("nothing", [], "protocol 'nothing' is not installed: choose one of dynamic-scene, ghost"),
        ("image-readout", ["colour=red"], "colour: image-readout has no such setting: choose from"),
        ("image-readout", ["images"], "--set images: write it as key=value"),
        ("image-readout", ["images=-3"], "images = '-3': "),
        ("image-readout", ["window=3 V"], "window = '3 V': '3 V' is not in s"),
        ("nowhere.toml", [], "nowhere.toml: cannot be read"),
    ],
)
def test_what_is_wrong_is_named(name: str, settings: list[str], message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        read_protocol(name, settings)


@pytest.mark.parametrize("text", ["[settings", "", 'protocol = "image-readout"\ncolour = 1'])
def test_a_file_that_is_no_protocol(tmp_path: Path, text: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ProtocolError, match=r"mine\.toml"):
        read_protocol(str(path), [])


def test_every_protocol_of_the_house_says_how_its_runs_are_judged() -> None:
    assert {name: judgement_of(name) for name in protocol_names()} == {
        "dynamic-scene": Judgement.EXPERIMENT,
        "ghost-imaging": Judgement.EXPERIMENT,
        "image-readout": Judgement.READOUT,
        "sequence-readout": Judgement.EXPERIMENT,
        "wavelength-scan": Judgement.ITSELF,
    }


def test_of_a_protocol_that_cannot_be_found_any_more_nothing_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert judgement_of("of-a-plug-in") is Judgement.NONE
    about = tmp_path / "gone_lab-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: gone-lab\nVersion: 1.0\n", "utf-8")
    (about / "entry_points.txt").write_text(f"[{GROUP}]\nof-a-plug-in = no_such_package:Protocol\n", "utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    assert judgement_of("of-a-plug-in") is Judgement.NONE
    with pytest.raises(ProtocolError, match="'of-a-plug-in' cannot be loaded"):
        read_protocol("of-a-plug-in", [])
