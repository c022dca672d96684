"""Tektronix AWG70002A arbitrary waveform generator.

Commands: AWG70000 series programmer manual. Blocks are little-endian float32 in -1..1; marker 1 is bit 6 of a marker
byte.
"""

import numpy as np

from instruments.interfaces import Awg, Drive, Identity, InstrumentError, Range
from instruments.visa import VisaLink

SLOW_S = 30.0
"""Bound on the commands that the manual calls overlapping: clock, assignment, run and stop."""


class Awg70002a(Awg):
    """One channel of an AWG70002A: 25 GS/s, 10-bit DAC shared with the markers.

    Drives shorter than the instrument's minimum are repeated, never padded with zeros: padding would leave the
    modulator idle for part of each period.
    """

    CHUNK_SAMPLES = 1_000_000
    SAMPLE_RATE = Range(1.49e3, 25e9, "S/s")
    AMPLITUDE = Range(0.25, 0.5, "Vpp")
    MARKER_HIGH_V, MARKER_LOW_V = 1.0, 0.0
    MARKER_1 = 0x40
    MARKER_RESOLUTION_BITS = 9  # 10 bits would take the marker's place
    TRIGGER_LEVEL_V = 1.4  # half of a TTL pulse
    WAITING, RUNNING = "1", "2"

    def __init__(self, link: VisaLink, *, channel: int = 1) -> None:
        """Drive `channel` of the instrument behind `link`."""
        self._link = link
        self._channel = channel

    def identify(self) -> Identity:
        """`*IDN?`."""
        return Identity.parse(self._link.query("*IDN?"))

    def self_test(self) -> None:
        """`*TST?`: 0 means passed."""
        result = self._link.query("*TST?", timeout_s=SLOW_S)
        if int(result) != 0:
            raise InstrumentError(
                f"{self._link.name}: self-test failed with code {result}: see the instrument's screen"
            )

    def load(self, drive: Drive, *, periods_per_trigger: int | None = None) -> float:
        """Upload `drive` with its marker, assign it, and return the rate the clock settled on.

        In triggered mode the marker is high in the first period only: one edge, and so one frame, a trigger. It starts
        with the falling edge, since a DMD's pulse begins with the picture and ends when its mirrors rest.

        Raises:
            OutOfRange: rate, amplitude or length outside the limits; nothing was sent.
            InstrumentError: the instrument's own error, with its text.
        """
        self.SAMPLE_RATE.check("drive sample rate", drive.sample_rate)
        self.AMPLITUDE.check("drive amplitude", drive.amplitude_vpp)
        source = f"SOURce{self._channel}"
        minimum, maximum = (int(self._link.query(f"WLISt:WAVeform:{limit}?")) for limit in ("LMINimum", "LMAXimum"))
        Range(1, maximum, "samples").check("drive length", drive.samples.size)
        markers = drive.marker * np.uint8(self.MARKER_1)
        if periods_per_trigger is None:
            samples = drive.repeated_to(minimum).astype("<f4", copy=False)
            markers = np.tile(markers, samples.size // drive.samples.size)
        else:
            samples = drive.repeated_to(max(minimum, periods_per_trigger * drive.samples.size)).astype(
                "<f4", copy=False
            )
            markers = np.concatenate([markers, np.zeros(samples.size - markers.size, np.uint8)])
        with self._link.checked():
            self._link.write("AWGControl:ARSettings 0")
            self._link.write(f'WLISt:WAVeform:DELete "{drive.name}"')
            self._link.errors()  # the waveform need not have been there
            self._link.write(f'WLISt:WAVeform:NEW "{drive.name}",{samples.size}')
            self._finish()
            for first in range(0, samples.size, self.CHUNK_SAMPLES):
                chunk = slice(first, first + self.CHUNK_SAMPLES)
                span = f'"{drive.name}",{first},{samples[chunk].size},'
                self._link.write_block(f"WLISt:WAVeform:DATA {span}", samples[chunk])
                self._link.write_block(f"WLISt:WAVeform:MARKer:DATA {span}", markers[chunk])
            self._link.write(f"{source}:DAC:RESolution {self.MARKER_RESOLUTION_BITS}")
            self._link.write(f"{source}:MARKer1:VOLTage:HIGH {self.MARKER_HIGH_V}")
            self._link.write(f"{source}:MARKer1:VOLTage:LOW {self.MARKER_LOW_V}")
            self._link.write(f"{source}:VOLTage {drive.amplitude_vpp:.4f}")
            if periods_per_trigger is None:
                self._link.write(f"{source}:RMODe CONTinuous")
            else:
                self._link.write(f"{source}:TINPut ATRigger")
                self._link.write(f"TRIGger:LEVel {self.TRIGGER_LEVEL_V},ATRigger")
                self._link.write("TRIGger:SLOPe NEGative,ATRigger")
                self._link.write(f"{source}:RMODe TRIGgered")
            self._link.write(f'{source}:CASSet:WAVeform "{drive.name}"')
            self._link.write(f"CLOCk:SRATe {drive.sample_rate:.9E}")
            self._finish()
        return float(self._link.query("CLOCk:SRATe?"))

    def play(self) -> None:
        """Run, then let it out: `AWGControl:RUN`, all-outputs-off released, output on."""
        with self._link.checked():
            self._link.write("AWGControl:RUN")
            self._finish()
            self._link.write("OUTPut:OFF 0")
            self._link.write(f"OUTPut{self._channel}:STATe 1")
        state = self._link.query("AWGControl:RSTate?")
        if state not in (self.WAITING, self.RUNNING):
            raise InstrumentError(
                f"{self._link.name}: does not run (AWGControl:RSTate? answers {state}): load a drive first"
            )

    def stop(self) -> None:
        """All outputs off at once, then stop."""
        with self._link.checked():
            self._link.write("OUTPut:OFF 1")
            self._link.write(f"OUTPut{self._channel}:STATe 0")
            self._link.write("AWGControl:STOP")
            self._finish()

    def settings(self) -> dict[str, str | float]:
        """Sample rate, amplitude, resolution, assigned waveform, run state and output."""
        source = f"SOURce{self._channel}"
        return {
            "sample_rate": float(self._link.query("CLOCk:SRATe?")),
            "clock_source": self._link.query("CLOCk:SOURce?"),
            "amplitude_vpp": float(self._link.query(f"{source}:VOLTage?")),
            "dac_bits": int(self._link.query(f"{source}:DAC:RESolution?")),
            "waveform": self._link.query(f"{source}:WAVeform?").strip('"'),
            "run_mode": self._link.query(f"{source}:RMODe?"),
            "output": int(self._link.query(f"OUTPut{self._channel}?")),
        }

    def make_safe(self) -> None:
        """Output off, stopped; errors of what went before are not held against it."""
        self._link.errors()
        self.stop()

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _finish(self) -> None:
        self._link.query("*OPC?", timeout_s=SLOW_S)
