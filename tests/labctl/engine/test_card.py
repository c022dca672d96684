"""A graphics card that gives out ends a run in one named error."""

from pathlib import Path

import pytest

from instruments.bench import Observer
from labctl.bench.station import SIMULATED_STATION
from labctl.engine.session import Acquisition, acquire
from protocols.image_readout import ImageReadout
from sim_backends.world.receivers import CardFull, ProcessorReceivers


class Events(Observer):
    """The names of a run's events."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def event(self, name: str, **_: object) -> None:
        self.names.append(name)


def test_a_card_without_room_ends_the_run_and_is_not_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    detect, count = ProcessorReceivers.detect, iter(range(1000))

    def gives_out(self: ProcessorReceivers, *seen: object) -> None:
        if next(count) > 50:
            raise CardFull
        detect(self, *seen)  # type: ignore[arg-type]

    monkeypatch.setattr(ProcessorReceivers, "detect", gives_out)
    events = Events()
    protocol = ImageReadout(images=40, window=0.4e-9, ports=(2, 3))
    with pytest.raises(CardFull, match=r"sim\.device = cpu"):
        acquire(Acquisition(protocol, SIMULATED_STATION, tmp_path / "run"), observer=events)
    assert "run started" in events.names
    assert "link lost" not in events.names
