"""What projects the masks of a run: drive, wavelengths and bench. A readout knows these masks and no others."""

import hashlib
from typing import Any, Self

from pydantic import BaseModel, ConfigDict

from instruments.values import Drive
from labctl.runs.format.manifest import protocol_settings
from labctl.runs.read.run import Run

SAMPLE_TOLERANCE = 1e-6
"""Part of a sample interval: it is written and read as decimal text."""


class Masks(BaseModel):
    """The masks of a run, as far as it says.

    drive: SHA-256 over samples and rate of the drive, in hex. drive_seed: what it was drawn from. wavelengths_nm: of
    all passes. columns: port and wavelength, nm, of each entry of the port axis; of a readout those that it sees, in
    its order. bench: name of its station. twin: seed and parameters of a simulated bench, none of a real one.
    """

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    drive: str | None
    drive_seed: int | None
    wavelengths_nm: tuple[float, ...]
    columns: tuple[tuple[int, float], ...] = ()  # earlier readouts do not say them
    sample_interval_s: float
    bench: str
    twin: dict[str, Any] | None

    @classmethod
    def of(cls, run: Run) -> Self:
        """Those of a run, whoever wrote its manifest."""
        station, seeds = _table(run.manifest, "station"), _table(run.manifest, "seeds")
        settings, twin = protocol_settings(run.manifest), _table(station, "sim")
        drive_seed = settings.get("drive_seed")
        drawn_from = settings.get("seed") if drive_seed is None else drive_seed
        simulated = isinstance(seeds.get("twin_seed"), int)
        return cls(
            drive=None if run.drive is None else _digest(run.drive),
            drive_seed=drawn_from if isinstance(drawn_from, int) else None,
            wavelengths_nm=tuple(sorted(set(run.shape.wavelengths_nm))),
            columns=tuple(zip(run.ports, run.shape.wavelength_of_port, strict=True)),
            sample_interval_s=run.shape.sample_interval_s,
            bench=str(station.get("name", "")),
            twin={key: twin.get(key) for key in ("twin_seed", "parameters")} if simulated else None,
        )

    def unlike(self, others: Self) -> str | None:
        """In a few words why a readout of these masks cannot work on `others`, and what to do; None if it can."""
        if self.drive != others.drive:
            again = "" if self.drive_seed is None else f" with --set drive_seed={self.drive_seed}"
            return f"its drive is not that of this run: measure{again}, or train anew"
        if self.twin != others.twin or (self.twin is None and self.bench != others.bench):
            return f"it was trained on {self._bench}, and this run is of {others._bench}: train anew"
        if not self.columns and self.wavelengths_nm != others.wavelengths_nm:
            return f"it was trained at {_in_nm(self)}, and this run is at {_in_nm(others)}: train anew"
        if missing := [one for one in self.columns if one not in others.columns]:
            port, wavelength_nm = missing[0]
            return (
                f"it was trained on port {port} at {wavelength_nm:.8g} nm, which this run does not hold: measure "
                "it, or train anew"
            )
        if abs(self.sample_interval_s - others.sample_interval_s) > SAMPLE_TOLERANCE * self.sample_interval_s:
            here, there = (f"{1e12 * one.sample_interval_s:g}" for one in (self, others))
            return f"its samples are {here} ps apart, here {there}: train anew"
        return None

    @property
    def _bench(self) -> str:
        if self.twin is None:
            return f"{self.bench!r}"
        changed = " of changed parameters" if self.twin["parameters"] else ""
        return f"simulated bench {self.twin['twin_seed']}{changed}"


def _digest(drive: Drive) -> str:
    return hashlib.sha256(f"{drive.sample_rate:g} ".encode() + drive.samples.tobytes()).hexdigest()


def _in_nm(masks: Masks) -> str:
    return f"{', '.join(f'{one:.8g}' for one in masks.wavelengths_nm)} nm"


def _table(values: Any, name: str) -> dict[str, Any]:
    found = values.get(name) if isinstance(values, dict) else None
    return found if isinstance(found, dict) else {}
