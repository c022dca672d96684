"""The drivers, through real sockets, against the virtual instruments."""

from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest

from instruments.bench import Bench
from instruments.errors import InstrumentError, LinkError, NoTrigger, OutOfRange, SettingChanged
from instruments.interfaces import BYPASS_PORT
from instruments.tektronix_awg70002a import TriggerInput
from instruments.tektronix_dpo72504dx import Dpo72504dx
from instruments.values import Change, Drive, EdgeTrigger, Loaded, Timebase, Vertical
from instruments.visa import VisaLink, tektronix_event_queue
from sim_backends.bench import SimulatedBench
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual import VirtualAlp
from sim_backends.virtual.awg70002a.channels import Source

AUX = EdgeTrigger("AUX", 0.5)


def drive(samples: int = 2500, *, rate: float = 25e9, amplitude: float = 0.5, name: str = "d") -> Drive:
    values = np.random.default_rng(0).uniform(-1, 1, samples).astype(np.float32)
    return Drive(name, values, rate, amplitude)


@pytest.fixture
def another_client(simulation: SimulatedBench, log: Any) -> Iterator[Callable[[str], str]]:
    """Somebody else says something to the AWG; answers to questions."""
    link = VisaLink(simulation.resources["awg"]["socket"], name="somebody", timeout_s=5, transcript=log)
    with closing(link):
        yield lambda text: link.query(text if "?" in text else f"{text};*OPC?")


def test_every_instrument_says_who_it_is(bench: Bench) -> None:
    models = {name: instrument.identify().model for name, instrument in bench.instruments.items()}
    assert models["awg"] == "AWG70002A"
    assert models["scope"] == "DPO72504DX"
    assert all(models[name] for name in ("laser", "dmd", "patch_panel"))


def test_every_instrument_passes_its_self_test_in_the_dark(bench: Bench) -> None:
    for instrument in bench.instruments.values():
        instrument.self_test()
    assert bench.laser.settings()["emitting"] == 0


class TestAwg:
    def test_plays_what_was_loaded(self, bench: Bench) -> None:
        assert bench.awg.load(drive()) == Loaded(25e9, drive().amplitude_vpp)
        bench.awg.play()
        settings = bench.awg.settings()
        assert (settings["waveform"], settings["output"], settings["dac_bits"]) == ("d", 1, 9)

    def test_what_an_earlier_user_left_is_set(self, bench: Bench, another_client: Callable[[str], str]) -> None:
        for left in ("INSTrument:MODE FGEN", "CLOCk:SOURce EXTernal", "TRIGger:SOURce INTernal", "SOURce1:SKEW 1E-10"):
            another_client(left)
        another_client("TRIGger:IMPedance 1000;MODE SYNChronous;LEVel 4;:SOURce1:MARKer1:DELay 5E-11;TINPut BTRigger")
        bench.awg.load(drive(), periods_per_trigger=3)
        bench.awg.play()
        found = bench.awg.settings()
        assert (found["mode"], found["clock_source"], found["skew_s"], found["marker_delay_s"]) == ("AWG", "INT", 0, 0)
        names = ("input", "source", "impedance_ohm", "level_v", "slope", "mode")
        assert [found[f"trigger_{name}"] for name in names] == ["ATR", "EXT", 50, 0.8, "NEG", "ASYN"]

    @pytest.mark.parametrize(("swing_v", "ohm", "level_v"), [(3.3, 50, 0.8), (3.3, 1000, 1.6), (5.0, 50, 1.2)])
    def test_the_trigger_level_is_half_of_what_comes(self, swing_v: float, ohm: int, level_v: float) -> None:
        assert TriggerInput(swing_v, ohm).level_v == pytest.approx(level_v)

    def test_another_channel_that_is_on_is_refused_by_name_before_there_is_light(
        self, bench: Bench, another_client: Callable[[str], str]
    ) -> None:
        another_client("OUTPut2 ON")
        refused = r"^awg: channel 2 is on, and would play what was left there: switch it off \(OUTPut2 OFF\)$"
        with pytest.raises(InstrumentError, match=refused), bench.emitting(1550.0):
            pytest.fail("there is light")
        bench.awg.load(drive())
        with pytest.raises(InstrumentError, match=refused):
            bench.awg.play()
        assert another_client("OUTPut:OFF?;:OUTPut1?") == "1;0"

    def test_another_channel_that_comes_on_is_noticed(self, bench: Bench, another_client: Callable[[str], str]) -> None:
        bench.awg.load(drive())
        bench.awg.play()
        assert bench.awg.changes() == ()
        another_client("OUTPut2 ON")
        assert bench.awg.changes() == (Change("OUTPut2:STATe", "0", "1"),)

    def test_without_an_option_there_is_no_path_to_choose(
        self, bench: Bench, log: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def refused(source: Source) -> str:
            raise ScpiError(-241, f"OUTPUT{source.number}:PATH")

        monkeypatch.setattr(Source, "path", property(refused))
        bench.awg.load(drive())
        bench.awg.play()
        assert bench.awg.changes() == ()

    def test_repeats_a_short_drive_instead_of_padding_it(self, bench: Bench, log: Any) -> None:
        bench.awg.load(drive(1000))
        new = next(text for text in log.sent_to("awg") if "WAVeform:NEW" in text)
        assert new.endswith(",3000")

    def test_loads_the_same_name_again(self, bench: Bench) -> None:
        bench.awg.load(drive())
        bench.awg.load(drive(5000))
        bench.awg.play()

    def test_a_long_drive_goes_in_chunks(self, bench: Bench, log: Any) -> None:
        bench.awg.load(drive(1_500_000))
        blocks = [text for text in log.sent_to("awg") if "WAVeform:DATA " in text]
        assert [text.split(",")[1:3] for text in blocks] == [["0", "1000000"], ["1000000", "500000"]]

    def test_the_longest_drive_arrives_whole(
        self, bench: Bench, simulation: SimulatedBench, log: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        longest = 5_000_000
        monkeypatch.setattr("sim_backends.virtual.awg70002a.waveforms.LONGEST", longest)
        told: list[int] = []
        bench.awg.load(drive(longest), progress=lambda done, _total: told.append(done))
        assert told == [1_000_000 * chunk for chunk in range(1, 6)]
        link = VisaLink(simulation.resources["awg"]["socket"], name="awg", timeout_s=5, transcript=log)
        found = link.read_block('WLISt:WAVeform:DATA? "d"', np.empty(longest, "<f4"))
        assert np.array_equal(found, drive(longest).samples)
        marker = link.read_block('WLISt:WAVeform:MARKer:DATA? "d"', np.empty(longest, np.uint8))
        assert np.array_equal(np.flatnonzero(marker & 0x40), np.arange(longest // 4))
        link.close()
        with pytest.raises(OutOfRange, match=r"drive length = 5e\+06 samples is outside|drive length"):
            bench.awg.load(drive(longest + 1))

    def test_an_upload_it_refuses_ends_at_once_in_its_own_words(
        self, bench: Bench, log: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with pytest.raises(InstrumentError, match=r"awg at TCPIP0.* reports -\d+"):
            bench.awg.load(drive(3_000_000, name='quote"inside'))
        assert not [text for text in log.sent_to("awg") if "WAVeform:DATA" in text]

    @pytest.mark.parametrize("wrong", [drive(rate=30e9), drive(amplitude=0.6)])
    def test_refuses_before_sending(self, bench: Bench, log: Any, wrong: Drive) -> None:
        with pytest.raises(OutOfRange, match=r"choose a value inside"):
            bench.awg.load(wrong)
        assert not log.messages

    def test_without_a_drive_it_does_not_play(self, bench: Bench) -> None:
        with pytest.raises(InstrumentError, match="awg"):
            bench.awg.play()

    def test_stopped_it_is_silent(self, bench: Bench) -> None:
        bench.awg.load(drive())
        bench.awg.play()
        bench.awg.make_safe()
        bench.awg.make_safe()
        assert bench.awg.settings()["output"] == 0


class TestScope:
    @pytest.fixture
    def second(self, simulation: SimulatedBench, log: Any) -> Iterator[VisaLink]:
        """Another client of the same oscilloscope."""
        link = VisaLink(simulation.resources["scope"]["socket"], name="second", timeout_s=5, transcript=log)
        yield link
        link.close()

    def test_captures_what_the_marker_triggers(self, bench: Bench) -> None:
        bench.awg.load(drive())
        bench.awg.play()
        bench.patch_panel.connect({1: 2, 2: 3})
        bench.scope.configure(Timebase(25e9, 50), AUX, (1, 2), 1)
        frames = bench.capture()
        assert frames.codes.shape == (1, 2, 50)
        assert frames.codes.dtype == np.int8
        assert frames.trigger_offset_s.shape == (1, 2)

    def test_of_a_longer_record_the_first_points_are_read(self, bench: Bench, second: VisaLink) -> None:
        bench.awg.load(drive())
        bench.awg.play()
        bench.scope.configure(Timebase(25e9, 50), AUX, (1,), 1)
        codes = bench.capture().codes[0, 0]
        assert second.query("HORizontal:MODE:RECOrdlength?") == "500", "what the instrument gives"
        whole = second.read_block("DATa:SOUrce CH1;STOP 500;:CURVe?", np.empty(500, np.int8))
        assert np.array_equal(codes, whole[:50])

    def test_a_mean_has_every_trigger_with_the_same_weight(self, bench: Bench, second: VisaLink) -> None:
        bench.awg.load(drive())
        bench.awg.play()
        bench.patch_panel.connect({1: 2, 2: 3})
        bench.scope.configure(Timebase(25e9, 50), AUX, (1, 2), 7)
        found = bench.capture()
        frames = second.read_block("CURVe?", np.empty((7, 50), np.int8))
        assert len(np.unique(frames, axis=0)) == 7
        assert np.array_equal(found.codes[0, 1], np.rint(256 * frames.mean(axis=0)))
        assert second.query("ACQuire:MODe?") == "SAMPLE", "what it calls an average is a running one"

    def test_a_mean_is_clipped_where_one_of_its_triggers_is(self, bench: Bench) -> None:
        bench.awg.load(drive())
        bench.awg.play()
        bench.scope.configure(Timebase(25e9, 50), AUX, (1,), 4)
        bench.scope.set_vertical(1, Vertical(0.01, 1.0))
        assert bench.capture().clipped.all()

    def test_a_delay_between_two_samples_counts_in_the_time_axis(self, bench: Bench, second: VisaLink) -> None:
        bench.awg.load(drive())
        bench.awg.play()
        for averages in (1, 4):
            bench.scope.configure(Timebase(25e9, 50, 1.01e-9), AUX, (1,), averages)
            offset = float(bench.capture().trigger_offset_s[0, 0])
            increment, trigger, zero = second.numbers("WFMOutpre:XINcr?;PT_Off?;XZEro?", 3)
            assert offset == pytest.approx(zero - trigger * increment - 1.01e-9, abs=1e-15)
            assert offset == pytest.approx(zero - 10e-12, abs=1e-15)

    def test_a_record_that_begins_elsewhere_is_no_record_of_the_shot(self, bench: Bench, second: VisaLink) -> None:
        bench.awg.load(drive())
        bench.awg.play()
        for averages in (1, 4):
            bench.scope.configure(Timebase(25e9, 50), AUX, (1,), averages)
            second.query("HORizontal:POSition 50;POSition?")
            with pytest.raises(
                SettingChanged, match=r"the trigger lies .* s beside the samples: its settings were changed"
            ):
                bench.capture()

    def test_the_rate_is_set_for_the_channels_that_are_on_then(self, bench: Bench) -> None:
        bench.scope.configure(Timebase(50e9, 50), AUX, (1, 2, 3, 4), 1)
        bench.scope.configure(Timebase(100e9, 50), AUX, (1, 2), 1)
        with pytest.raises(InstrumentError, match=r"SAMPLERate: asked for 1e\+11 S/s, got 5e\+10 S/s"):
            bench.scope.configure(Timebase(100e9, 50), AUX, (1, 2, 3, 4), 1)

    @pytest.mark.parametrize(
        "left",
        [
            *("CH1:INVert ON", "CH1:COUPling GND", "CH1:BANdwidth 1E9", "CH1:DESKew 4E-9", "CH1:PROBEFunc:EXTAtten 10"),
            *("CH1:POSition 2", "CH1:OFFSet 0.5", "HORizontal:POSition 50", "HORizontal:MAIn:DELay:MODe ON"),
            *("TRIGger:A:HOLDoff:BY TIMe", "TRIGger:A:EDGE:COUPling AC", "TRIGger:A:MODe AUTO", "TRIGger:AUXLevel 1"),
            *("TRIGger:A:EDGE:SLOpe:AUX FALL", "ACQuire:MODe AVErage", "ACQuire:SAMPlingmode IT", "SELect:CH3 ON"),
            *("HORizontal:FASTframe:STATE ON", "DATa:ENCdg RPBinary", "WFMOutpre:BYT_Nr 2", "DATa:STARt 7"),
        ],
    )
    def test_what_a_former_user_left_is_set(self, bench: Bench, second: VisaLink, left: str) -> None:
        question = f"{left.split()[0]}?"
        found = second.query(f"{left};:{question}")
        bench.scope.configure(Timebase(25e9, 50), AUX, (1,), 1)
        bench.scope.set_vertical(1, Vertical(0.1, 0.0))
        assert second.query(question) != found

    def test_the_most_frames_are_those_of_frames(self, bench: Bench) -> None:
        bench.awg.load(drive())
        bench.awg.play()
        bench.scope.configure(Timebase(25e9, 50), AUX, (1,), 1)
        assert bench.scope.most_frames() == 625_000
        assert bench.capture().codes.shape == (1, 1, 50)
        bench.scope.arm_burst(3)
        assert bench.scope.most_frames() == 625_000
        assert bench.scope.read_burst().codes.shape == (3, 1, 50)

    def test_averages_are_sixteen_bit(self, bench: Bench) -> None:
        bench.awg.load(drive())
        bench.awg.play()
        bench.patch_panel.connect({1: 2})
        bench.scope.configure(Timebase(25e9, 50), AUX, (1,), 16)
        bench.scope.set_vertical(1, Vertical(0.01, 0.0))
        averaged = bench.capture().codes
        assert averaged.dtype == np.int16
        (fine,) = bench.scope.scalings()
        bench.scope.configure(Timebase(25e9, 50), AUX, (1,), 1)
        bench.capture()
        (coarse,) = bench.scope.scalings()
        assert coarse.scale_v == pytest.approx(256 * fine.scale_v)

    def test_reports_clipping(self, bench: Bench) -> None:
        bench.awg.load(drive())
        bench.awg.play()
        bench.patch_panel.connect({1: 2})
        bench.scope.configure(Timebase(25e9, 50), AUX, (1,), 1)
        bench.scope.set_vertical(1, Vertical(0.01, 1.0))
        assert bench.capture().clipped.all()
        bench.scope.set_vertical(1, Vertical(0.5, 0.0))
        assert not bench.capture().clipped.any()

    def test_a_setting_that_does_not_take_is_an_error(self, bench: Bench) -> None:
        with pytest.raises(InstrumentError, match="scope"):
            bench.scope.configure(Timebase(25e9, 10**12), AUX, (1,), 1)

    def test_its_own_errors_are_told(self, bench: Bench) -> None:
        with pytest.raises(InstrumentError, match="reports"):
            bench.scope.set_vertical(7, Vertical(0.1, 0.0))

    def test_a_transfer_it_refuses_ends_in_its_own_words(self, simulation: SimulatedBench, log: Any) -> None:
        link = VisaLink(
            simulation.resources["scope"]["socket"],
            name="scope",
            timeout_s=1,
            transcript=log,
            error_queue=tektronix_event_queue,
        )
        scope = Dpo72504dx(link)
        scope.configure(Timebase(25e9, 50), AUX, (1,), 1)
        with pytest.raises(InstrumentError, match=r"scope at TCPIP0.* reports 2241,"):
            scope.read()
        link.close()

    def test_a_range_is_set_again_from_what_its_codes_mean(self, bench: Bench) -> None:
        bench.awg.load(drive())
        bench.awg.play()
        for averages in (1, 4):
            bench.scope.configure(Timebase(25e9, 50), AUX, (1, 2), averages)
            for channel, vertical in ((1, Vertical(0.0123456789, 0.00123456789)), (2, Vertical(0.6, -0.98765432))):
                bench.scope.set_vertical(channel, vertical)
            bench.capture()
            scalings = bench.scope.scalings()
            for channel, scaling in zip((1, 2), scalings, strict=True):
                bench.scope.set_vertical(channel, Vertical(0.1, 0.0))
                bench.scope.set_vertical(channel, bench.scope.vertical_for(scaling))
            bench.capture()
            assert bench.scope.scalings() == scalings

    def test_no_trigger_ends_in_a_clear_error(self, bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("instruments.tektronix_dpo72504dx.TRIGGER_WAIT_S", 0.2)
        bench.scope.configure(Timebase(25e9, 50), AUX, (1,), 1)
        bench.scope.arm()
        with pytest.raises(NoTrigger, match=r"scope at .* no trigger came within 0.2 s: check"):
            bench.scope.wait()
        bench.scope.make_safe()
        assert bench.scope.settings()["sample_rate"] == 25e9

    def test_no_trigger_of_a_burst_ends_at_once(self, bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("instruments.tektronix_dpo72504dx.STALLED_S", 0.05)
        bench.scope.configure(Timebase(25e9, 50), AUX, (1,), 1)
        bench.scope.arm_burst(7)
        with pytest.raises(NoTrigger, match=r"scope at .* took 0 of 7 frames, and none for 0.05 s: check"):
            bench.scope.read_burst()
        bench.scope.make_safe()
        assert bench.scope.settings()["sample_rate"] == 25e9

    def test_a_link_lost_while_it_waits_is_a_lost_link(
        self, bench: Bench, simulation: SimulatedBench, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("instruments.tektronix_dpo72504dx.TRIGGER_WAIT_S", 0.2)
        bench.scope.configure(Timebase(25e9, 50), AUX, (1,), 1)
        bench.scope.arm()
        simulation.stop()
        with pytest.raises(LinkError, match=r"scope at .* cannot be reached"):
            bench.scope.wait()


class TestLaser:
    def test_emits_what_was_asked(self, bench: Bench) -> None:
        bench.laser.set_power(0.02)
        bench.laser.tune(1551.0)
        bench.laser.emit()
        settings = bench.laser.settings()
        assert settings["wavelength_nm"] == pytest.approx(1551.0)
        assert settings["power_dbm"] == pytest.approx(13.01, abs=0.01)
        assert settings["emitting"] == 1
        bench.laser.make_safe()
        assert bench.laser.settings()["emitting"] == 0

    @pytest.mark.parametrize("wavelength_nm", [1500.0, 1600.0, float("nan")])
    def test_refuses_other_bands(self, bench: Bench, wavelength_nm: float) -> None:
        with pytest.raises(OutOfRange, match="wavelength"):
            bench.laser.tune(wavelength_nm)

    @pytest.mark.parametrize("power_w", [0.0, 1.0])
    def test_refuses_other_powers(self, bench: Bench, power_w: float) -> None:
        with pytest.raises(OutOfRange, match="power"):
            bench.laser.set_power(power_w)


class TestDmd:
    def test_shows_the_very_bits(self, bench: Bench, simulation: SimulatedBench) -> None:
        rows, columns = bench.dmd.shape
        assert (rows, columns) == (768, 1024)
        pattern = np.random.default_rng(1).integers(0, 256, (rows, columns // 8), dtype=np.uint8)
        bench.dmd.show(pattern)
        bench.dmd.show(np.flip(pattern))
        bench.dmd.blank()

    def test_can_be_opened_again(self, bench: Bench) -> None:
        bench.dmd.blank()
        bench.dmd.close()
        bench.dmd.blank()
        bench.dmd.close()

    @pytest.mark.parametrize("transport", ["socket", "hislip"])
    def test_a_device_that_a_client_left_allocated_is_free(
        self, bench: Bench, simulation: SimulatedBench, log: Any, transport: str
    ) -> None:
        for _ in range(20):
            forgotten = VisaLink(simulation.resources["dmd"][transport], name="dmd", timeout_s=5, transcript=log)
            assert forgotten.query("ALP:DEVALLOC") == "0"
            forgotten.close()
        bench.dmd.blank()

    def test_a_device_that_somebody_has_is_nobody_elses(
        self, bench: Bench, simulation: SimulatedBench, log: Any
    ) -> None:
        pattern = np.full((768, 128), 255, np.uint8)
        bench.dmd.show(pattern)
        other = VisaLink(simulation.resources["dmd"]["socket"], name="dmd", timeout_s=5, transcript=log)
        answers = [other.query(line) for line in ("ALP:DEVALLOC", "ALP:DEVHALT", "ALP:DEVFREE")]
        assert answers == ["1004", "1003", "1003"]
        other.close()
        assert bench.dmd.changes() == ()
        bench.dmd.show(pattern)

    def test_a_device_that_forgot_the_driver_is_made_safe(self, bench: Bench, simulation: SimulatedBench) -> None:
        pattern = np.full((768, 128), 255, np.uint8)
        bench.dmd.show(pattern)
        dmd = simulation._instruments["dmd"]
        assert isinstance(dmd, VirtualAlp)
        dmd.reset()
        with pytest.raises(InstrumentError, match="returned 10"):
            bench.dmd.show(pattern)
        bench.dmd.make_safe()
        bench.dmd.show(pattern)

    def test_reports_return_codes_in_words(self, bench: Bench) -> None:
        with pytest.raises(InstrumentError, match=r"ALP:SEQPUT returned 10\d\d: "):
            bench.dmd.show(np.zeros((10, 10), np.uint8))


class TestPatchPanel:
    def test_connects_and_nothing_else(self, bench: Bench) -> None:
        bench.patch_panel.connect({1: 2, 2: 3, 3: 4, 4: 5})
        bench.patch_panel.connect({1: 6})
        assert bench.patch_panel.settings()["routes"] == "(@1!6)"
        bench.patch_panel.connect({1: BYPASS_PORT})

    def test_refuses_a_port_that_is_not_wired(self, bench: Bench) -> None:
        with pytest.raises(OutOfRange, match="port 10 is not wired"):
            bench.patch_panel.connect({1: 10})
