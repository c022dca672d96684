"""What every virtual instrument does alike: common commands, compound messages, errors, waiting."""

from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sim_backends.parameters import Parameters
from sim_backends.scpi.arguments import keyword, quoted, real
from sim_backends.scpi.commands import Action, Command, Query, Setting
from sim_backends.virtual import (
    VirtualAlp,
    VirtualAwg70002a,
    VirtualDpo72504dx,
    VirtualFibreSwitch,
    VirtualInstrument,
    VirtualTlg220,
)
from sim_backends.virtual.instrument import ERROR_QUEUE
from sim_backends.world.world import World
from tests.sim_backends.virtual.watched import Ask, Read, Watched


class Oven(VirtualInstrument):
    """A small instrument: heating goes on while other commands are accepted."""

    IDENTITY = "labctl,oven,1,1"
    COMMANDS = (
        Setting("TEMPerature", "temperature", real(20, 300)),
        Setting("MODE", "mode", keyword("HEATing", "OFF")),
        Setting("PROGram:NAME", "program", quoted),
        Action("DOOR:OPEN", "open_door"),
        Query("DOOR?", "door"),
        *ERROR_QUEUE,
    )

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self.temperature = 20.0
        self.mode = "OFF"
        self.program = ""
        self.heating = False
        self.triggers = 0
        self.changes = 0

    def pending(self) -> bool:
        return self.heating

    def changed(self, _command: Command) -> None:
        self.changes += 1

    def bus_trigger(self) -> None:
        self.triggers += 1

    def open_door(self) -> None:
        self.heating = False

    def door(self) -> str:
        return "SHUT" if self.heating else "OPEN"


@pytest.fixture
def oven(world: World) -> Oven:
    return Oven(world)


def test_common_commands(ask: Ask, oven: Oven) -> None:
    assert ask(oven, "*IDN?") == b"labctl,oven,1,1"
    assert ask(oven, "*opt?;*tst?;*OPC?") == b"0;0;1"
    ask(oven, "*ESE 32;*SRE 32;*WAI;*RST;*TRG")
    assert ask(oven, "*ESE?;*SRE?;*STB?") == b"32;32;16"
    assert oven.triggers == 1
    ask(oven, "FOO")
    assert ask(oven, "*STB?") == b"100"
    assert oven.status_byte() == 100
    assert ask(oven, "*ESR?") == b"32"
    ask(oven, "*CLS")
    assert oven.status_byte() == 0


def test_one_reply_to_a_compound_message(ask: Ask, oven: Oven) -> None:
    assert ask(oven, "TEMP 100;MODE HEAT;TEMP?;MODE?;:PROG:NAME 'a;b';NAME?") == b'1.0000000000E+02;HEAT;"a;b"'


def test_an_error_changes_nothing_and_the_rest_goes_on(ask: Ask, oven: Oven) -> None:
    assert ask(oven, "TEMP 500;BAR 3;BAR?;MODE COLD;TEMP;TEMP 30,2;TEMP?;'") == b"2.0000000000E+01"
    assert ask(oven, "SYST:ERR:CODE:ALL?") == b"-222,-113,-113,-224,-109,-108,-102"
    assert ask(oven, "SYST:ERR?;ERR:COUN?") == b'0,"No error";0'


def test_a_settings_query_takes_no_argument(ask: Ask, oven: Oven) -> None:
    assert ask(oven, "TEMP? 3") == b""
    assert ask(oven, "SYST:ERR:CODE?") == b"-108"


def test_headers_and_long_words(ask: Ask, oven: Oven) -> None:
    oven.headers = True
    assert ask(oven, "MODE HEAT;MODE?;*OPC?;:DOOR?") == b":MODE HEAT;1;:DOOR OPEN"
    oven.verbose = True
    assert ask(oven, "MODE?;:PROG:NAME?") == b':MODE HEATING;:PROGRAM:NAME ""'


def test_completion_is_waited_for(ask: Ask, read: Read, oven: Oven) -> None:
    oven.heating = True
    (message,) = read("TEMP?;*OPC?;MODE?")
    execution = oven.run(message)
    next(execution)
    next(execution)
    assert ask(oven, "DOOR?") == b"SHUT"
    ask(oven, "DOOR:OPEN")
    with pytest.raises(StopIteration) as end:
        next(execution)
    assert b"".join(end.value.value) == b"2.0000000000E+01;1;OFF"
    oven.heating = True
    with pytest.raises(BlockingIOError):
        ask(oven, "*WAI")


def test_opc_sets_its_bit_when_everything_is_done(ask: Ask, oven: Oven) -> None:
    oven.heating = True
    ask(oven, "*OPC")
    assert ask(oven, "*ESR?") == b"0"
    oven.heating = False
    assert ask(oven, "*ESR?") == b"1"
    oven.heating = True
    ask(oven, "*OPC")
    oven.clear()
    oven.heating = False
    assert ask(oven, "*ESR?") == b"0"
    ask(oven, "*OPC")
    assert oven.status_byte() == 0
    assert ask(oven, "*ESR?") == b"1"


def test_only_commands_count_as_changes(ask: Ask, oven: Oven) -> None:
    ask(oven, "TEMP 50;TEMP?;FOO;DOOR?")
    assert oven.changes == 1


EVERY = (VirtualAwg70002a, VirtualDpo72504dx, VirtualTlg220, VirtualAlp, VirtualFibreSwitch)


@pytest.mark.parametrize("model", EVERY)
def test_every_instrument_identifies_itself_with_four_fields(ask: Ask, world: World, model: Any) -> None:
    instrument = model(world)
    assert len(ask(instrument, "*IDN?").split(b",")) == 4
    assert ask(instrument, "*OPC?;*ESR?;*TST?") == b"1;0;0"
    ask(instrument, "*RST;*CLS;*WAI;*TRG")
    assert ask(instrument, "*ESR?") == b"0"


@pytest.mark.parametrize("model", EVERY)
def test_every_setting_can_be_read(ask: Ask, world: World, model: Any) -> None:
    instrument = model(world)
    for command in model.COMMANDS:
        if isinstance(command, Setting):
            header = command.header.replace("[", "").replace("]", "").replace("#", "1")
            refused = header.endswith(":OFFSet") and "VOLTage:LEVel" in header and "MARKer" not in header
            assert (ask(instrument, f"{header}?") == b"") == refused, header


@pytest.mark.parametrize("model", EVERY)
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_nothing_a_client_sends_raises(read: Read, model: Any, data: st.DataObject) -> None:
    instrument = model(World(Parameters(light_path="direct", chip_modes=50)))
    headers = [command.header.replace("[", "").replace("]", "") for command in model.COMMANDS]
    texts = ["1", "0", "-1", "1e9", '"a"', "ALL", "ON", "(@1!2)", "(@1)", "#12ab", "2500", "CH1", "", "x", "1,2,3"]
    replies: list[object] = []
    for _ in range(data.draw(st.integers(1, 6))):
        header = data.draw(st.sampled_from([*headers, "FOO", "*OPC", "ALP:SEQPUT"]))
        header = header.replace("#", data.draw(st.sampled_from(["", "1", "9"])))
        mark = data.draw(st.sampled_from(["?", ""]))
        for message in read(f"{header}{mark} {data.draw(st.sampled_from(texts))}"):
            try:
                next(instrument.run(message))
            except StopIteration as end:
                replies += end.value
    assert all(isinstance(chunk, (bytes, memoryview)) for chunk in replies)


@pytest.mark.parametrize(
    ("model", "real", "nonsense", "asked"),
    [
        (VirtualDpo72504dx, "CURSor:FUNCtion?", "CURSor:NONSENSE?", "*ESR?;:ALLEv?"),
        (VirtualAwg70002a, "CALibration:ALL?", "CALibration:NONSENSE?", "*ESR?;:SYSTem:ERRor:ALL?"),
    ],
)
def test_a_real_header_that_is_not_simulated_is_told_apart_from_nonsense(
    ask: Ask,
    world: Watched,
    caplog: pytest.LogCaptureFixture,
    model: type[VirtualInstrument],
    real: str,
    nonsense: str,
    asked: str,
) -> None:
    instrument = model(world)
    assert ask(instrument, nonsense) == b""
    assert b"not simulated" not in ask(instrument, asked)
    assert not caplog.records
    assert ask(instrument, real) == b""
    told = ask(instrument, asked).decode()
    header = real.removesuffix("?")
    assert told.startswith("32;")
    assert "113," in told
    assert f"{header} is a real header that is not simulated" in told
    assert [record.getMessage() for record in caplog.records] == [
        f"{model.__name__}: {header} is a real header that is not simulated"
    ]
