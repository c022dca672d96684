"""The virtual fibre switch: crosspoints, conflicts, and what the world is told."""

import pytest

from sim_backends.virtual import VirtualFibreSwitch
from sim_backends.world.world import World
from tests.sim_backends.virtual.watched import Ask


@pytest.fixture
def switch(world: World) -> VirtualFibreSwitch:
    return VirtualFibreSwitch(world)


def routes(ask: Ask, switch: VirtualFibreSwitch) -> str:
    """Every route that is closed."""
    crosspoints = [f"{channel}!{port}" for channel in range(1, 5) for port in range(15)]
    closed = ask(switch, f"ROUTe:CLOSe? (@{','.join(crosspoints)})").decode().split(",")
    return f"(@{','.join(name for name, one in zip(crosspoints, closed, strict=True) if one == '1')})"


def test_connects_and_replaces(ask: Ask, switch: VirtualFibreSwitch, world: World) -> None:
    assert routes(ask, switch) == "(@)"
    ask(switch, "ROUTe:CLOSe (@2!3)\nROUT:CLOS (@1!2)")
    assert routes(ask, switch) == "(@1!2,2!3)"
    ask(switch, "ROUTe:CLOSe (@1!0,4!14)")
    assert routes(ask, switch) == "(@1!0,2!3,4!14)"
    assert world._patching == {1: 0, 2: 3, 4: 14}
    ask(switch, "ROUTe:OPEN (@2,4)")
    assert routes(ask, switch) == "(@1!0)"
    ask(switch, "ROUTe:OPEN:ALL")
    assert routes(ask, switch) == "(@)"
    assert ask(switch, "*OPC?;:SYST:ERR?") == b'1;0,"No error"'
    assert world._patching == {}


def test_each_of_a_list_is_asked_for_in_its_order(ask: Ask, switch: VirtualFibreSwitch) -> None:
    ask(switch, "ROUTe:CLOSe (@1!2,2!3)")
    assert ask(switch, "ROUT:CLOS? (@2!3,1!3,1!2)") == b"1,0,1"


def test_ports_can_be_exchanged_at_once(ask: Ask, switch: VirtualFibreSwitch) -> None:
    ask(switch, "ROUTe:CLOSe (@1!2,2!3);CLOSe (@1!3,2!2)")
    assert routes(ask, switch) == "(@1!3,2!2)"


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("ROUTe:CLOSe (@2!2)", b"-221"),
        ("ROUTe:CLOSe (@3!4,4!4)", b"-221"),
        ("ROUTe:CLOSe (@5!3)", b"-222"),
        ("ROUTe:CLOSe (@0!3)", b"-222"),
        ("ROUTe:CLOSe (@2!15)", b"-222"),
        ("ROUTe:OPEN (@5)", b"-222"),
        ("ROUTe:CLOSe (@2)", b"-104"),
        ("ROUTe:CLOSe 2,3", b"-108"),
        ("ROUTe:CLOSe", b"-109"),
        ("ROUTe:CLOSe?", b"-109"),
        ("ROUTe:CLOSe? (@1!2,5!3)", b"-222"),
        ("ROUTe:SHUT", b"-113"),
    ],
)
def test_refusals(ask: Ask, switch: VirtualFibreSwitch, line: str, code: bytes) -> None:
    ask(switch, "ROUTe:CLOSe (@1!2)")
    assert ask(switch, line) == b""
    assert ask(switch, "SYSTem:ERRor:CODE:ALL?") == code
    assert routes(ask, switch) == "(@1!2)"


def test_switching_takes_time_only_when_something_moves(ask: Ask, switch: VirtualFibreSwitch, world: World) -> None:
    ask(switch, "ROUTe:CLOSe (@1!2,2!3)")
    assert world.clock.now == pytest.approx(10e-3)
    ask(switch, "ROUTe:CLOSe (@1!2);OPEN (@4);*RST")
    assert world.clock.now == pytest.approx(20e-3)
