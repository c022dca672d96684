"""What a run may go on with: what its manifest says, and nothing else."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from labctl.bench.station import Station
from labctl.engine.recorded_protocol import protocol_of_manifest, refuse_other_inputs
from labctl.engine.resume import SettingsChanged, own_station, refuse_changed_instruments, station_of_manifest
from labctl.engine.session import Resumption, resume
from labctl.errors import RunError, StationError
from labctl.runs.format.version import FORMAT_VERSION
from protocols.base import Images
from protocols.dynamic_scene import DynamicScene
from protocols.image_readout import ImageReadout
from protocols.sequence_readout import SequenceReadout
from protocols.wavelength_scan import WavelengthScan

HERE = Path("run")
INSTRUMENTS = {
    "awg": {"identity": {"serial": "B1"}, "settings": {"clock_phase_deg": 0.0, "run_mode": "CONT"}},
    "scope": {"identity": {"serial": "C1"}, "settings": {"ch1_probe_ohm": 50.0, "ch1_offset_v": 0.0}},
}
MANIFEST = {"instruments": INSTRUMENTS, "format_version": FORMAT_VERSION}


def through_json(values: Any) -> Any:
    return json.loads(json.dumps(values))


@pytest.mark.parametrize(
    "protocol",
    [
        ImageReadout(images=(20, 10), window=0.8e-9, ports=(0, 3), wavelengths=(1550.0, 1551.5), classes=(0, 1)),
        DynamicScene(scenes=1, averages=3),
        SequenceReadout(symbols=100),
        WavelengthScan(steps=3),
    ],
)
def test_every_protocol_comes_back_from_a_manifest(protocol: Any) -> None:
    asked = {"name": protocol.name, "digest": protocol.digest(), "settings": protocol.model_dump(mode="json")}
    assert protocol_of_manifest(HERE, through_json({"protocol": asked})) == protocol
    with pytest.raises(RunError, match="settings differently: resume with the version"):
        protocol_of_manifest(HERE, {"protocol": asked | {"digest": "0" * 64}})
    with pytest.raises(RunError, match="the manifest has no protocol settings"):
        protocol_of_manifest(HERE, {"protocol": "image-readout"})


def test_a_station_comes_back_and_may_change_what_is_the_benchs_own() -> None:
    begun = Station.model_validate({"scope": {"channels": [1, 2]}, "sim": {"parameters": {"enob": 6.0}}})
    manifest = through_json({"station": begun.model_dump(mode="json")})
    assert station_of_manifest(HERE, manifest, None) == begun
    moved = begun.model_copy(
        update={
            "source": "bench.toml",
            "awg": begun.awg.model_copy(update={"address": "TCPIP0::1.2.3.4::INSTR"}),
            "laser": begun.laser.model_copy(update={"armed": True}),
            "durability": begun.durability.model_copy(update={"shots": 1}),
            "limits": begun.limits.model_copy(update={"detector": 0.3}),
        }
    )
    assert station_of_manifest(HERE, manifest, moved) == moved
    with pytest.raises(SettingsChanged) as changed:
        station_of_manifest(HERE, manifest, begun.twin(2))
    (difference,) = changed.value.differences
    assert (difference.setting, difference.then, difference.now) == ("station sim.twin_seed", 1, 2)
    with pytest.raises(RunError, match="does not name the station"):
        station_of_manifest(HERE, {}, None)
    with pytest.raises(RunError, match=r"awg\.colour = 'red': unknown key"):
        station_of_manifest(HERE, {"station": {"awg": {"colour": "red"}}}, None)


def test_a_run_names_no_file_to_load() -> None:
    begun = {"laser": {"commands": "/dev/zero"}, "dmd": {"library": "/home/theirs"}}
    assert station_of_manifest(HERE, {"station": begun}, None) == Station()
    own = Station.model_validate({"laser": {"commands": "/etc/labctl/laser.toml"}})
    assert station_of_manifest(HERE, {"station": begun}, own) == own


def test_only_a_wholly_simulated_run_has_its_bench_with_it() -> None:
    assert own_station(HERE, Station()) == Station()
    elsewhere = Station.model_validate({"laser": {"address": "TCPIP0::192.0.2.1::5025::SOCKET"}})
    with pytest.raises(
        StationError, match=r"run: no run was begun here with the station file 'built-in station' as it"
    ):
        own_station(HERE, elsewhere)


def test_a_station_comes_back_from_a_manifest_of_when_all_drivers_of_a_role_had_the_same_keys() -> None:
    """What labctl 0.1 wrote of instruments whose drivers have no use for some of the keys."""
    laser = {"driver": "manual-laser", "address": "simulated", "commands": None, "armed": True, "power": 0.03}
    dmd = {"driver": "ti-dlpc900", "address": "usb", "version": "4.3", "library": None, "timeout": 5.0}
    panel = {"driver": "manual-patch-panel", "address": "simulated", "ports": [0, 2], "bypass": False, "timeout": 5.0}
    begun = station_of_manifest(HERE, {"station": {"laser": laser, "dmd": dmd, "patch_panel": panel}}, None)
    assert begun.patch_panel.ports == (0, 2)
    assert station_of_manifest(HERE, {"station": {"laser": laser, "dmd": dmd, "patch_panel": panel}}, begun) == begun
    with pytest.raises(RunError, match=r"run: station in the manifest: laser\.driver = 'gone' is not installed"):
        station_of_manifest(HERE, {"station": {"laser": laser | {"driver": "gone"}}}, None)


@pytest.mark.parametrize(
    ("change", "differences"),
    [
        (lambda found: None, []),
        (lambda found: found["awg"]["settings"].update(run_mode="TRIG"), []),
        (lambda found: found["scope"]["settings"].update(ch1_offset_v=0.2), []),
        (lambda found: found.update(power_meter={"identity": {"serial": "P1"}}), []),
        (lambda found: found["scope"]["settings"].update(ch1_probe_ohm=50.0 + 1e-9), []),
        (lambda found: found["awg"]["identity"].update(serial="B2"), [("awg identity.serial", "B1", "B2")]),
        (
            lambda found: found["scope"]["settings"].pop("ch1_probe_ohm"),
            [("scope settings.ch1_probe_ohm", 50.0, None)],
        ),
        (
            lambda found: found["awg"]["settings"].update(clock_phase_deg=10.0, filter="on"),
            [("awg settings.clock_phase_deg", 0.0, 10.0), ("awg settings.filter", None, "on")],
        ),
    ],
)
def test_instruments_are_compared_but_for_what_every_run_sends(
    change: Callable[[Any], object], differences: list[tuple[object, ...]]
) -> None:
    now = through_json(INSTRUMENTS)
    change(now)
    if not differences:
        refuse_changed_instruments(HERE, MANIFEST, now, Station())
        return
    with pytest.raises(SettingsChanged) as changed:
        refuse_changed_instruments(HERE, MANIFEST, now, Station())
    assert [tuple(vars(one).values()) for one in changed.value.differences] == differences


def test_other_images_are_refused() -> None:
    images = Images(np.zeros((1, 2, 2), np.bool_), np.zeros(1, np.int64), np.zeros(1, np.int64))
    refuse_other_inputs(HERE, {"inputs_sha256": images.digest}, images)
    with pytest.raises(RunError, match="data set differs from the one"):
        refuse_other_inputs(HERE, {"inputs_sha256": "0"}, images)


def test_what_is_no_run_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="not a run directory"):
        resume(Resumption(tmp_path))
