"""Settings that several protocols share mean the same, and are refused in the same words, in each of them."""

import pytest

from protocols.base import ProtocolError
from protocols.registry import read_protocol


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
