"""Settings that several protocols share mean the same, and are refused in the same words, in each of them."""

import pytest

from labctl.engine.inputs import images_for
from protocols.base import ProtocolError
from protocols.registry import read_protocol
from protocols.settings import samples_in


@pytest.mark.parametrize("protocol", ["image-readout", "dynamic-scene", "sequence-readout", "wavelength-scan"])
def test_a_port_is_named_once(protocol: str) -> None:
    with pytest.raises(ProtocolError, match=r"^--set: ports = '2-3,2': \(2, 3, 2\) names one twice: list each once$"):
        read_protocol(protocol, ["ports=2-3,2"])


@pytest.mark.parametrize("protocol", ["image-readout", "dynamic-scene", "sequence-readout"])
def test_a_wavelength_is_named_once(protocol: str) -> None:
    with pytest.raises(ProtocolError, match="names one twice: list each once"):
        read_protocol(protocol, ["wavelengths=1550 nm,1.55 um"])


def test_a_number_of_images_is_a_number_several_or_all() -> None:
    for text, images in (("12", 12), ("12,5", (12, 5)), ("all", "all")):
        assert read_protocol("image-readout", [f"images={text}"]).model_dump()["images"] == images
    with pytest.raises(ProtocolError, match=r"'every' is not a number of images: write 1000, .* or 'all'$"):
        read_protocol("image-readout", ["images=every"])


@pytest.mark.parametrize("protocol", ["image-readout", "ghost-imaging", "dynamic-scene", "wavelength-scan"])
def test_a_window_is_a_whole_number_of_samples(protocol: str) -> None:
    """Files and figures say what was asked for: no other window may be measured."""
    asked = read_protocol(protocol, ["images=40", "window=0.5 ns"])
    with pytest.raises(ProtocolError, match=r"^window = 0\.5 ns is .* of 0\.04 ns samples: use 0\.48 ns or 0\.52 ns$"):
        asked.sample_count(images_for(asked))


@pytest.mark.parametrize(
    ("time_s", "near"), [(0.03e-9, "use 0.04 ns"), (19.99999e-6, "use 19999.96 ns or 20000 ns"), (1.02e-9, "1 ns or")]
)
def test_the_nearest_times_are_named(time_s: float, near: str) -> None:
    with pytest.raises(ProtocolError, match=near):
        samples_in("window", time_s, 25e9)
