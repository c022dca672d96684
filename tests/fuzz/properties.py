"""What must hold whatever a client sends: no exception, the link in step, one effect for all spellings.

Each property takes hypothesis' `data` and a model; `test_instruments` runs a bounded number of examples of each,
`run` as many as fit into the time it is given.
"""

import re
from collections.abc import Callable

from hypothesis import strategies as st

from sim_backends.virtual import VirtualAlp, VirtualAwg70002a, VirtualInstrument
from tests.fuzz.inputs import (
    Statement,
    canonical,
    conversations,
    garbage,
    laser_texts,
    spelled,
    statements,
)
from tests.fuzz.link import Link

INQUIRY = b"ALP:DEVINQUIRE 2000"

Property = Callable[[st.DataObject, type[VirtualInstrument]], None]

_DETAIL = re.compile(rb'(-?[0-9]+,"[^";]*);(?:[^"]|"")*"')

_cuts = st.lists(st.integers(1, 400), max_size=12)


def stays_in_step(data: st.DataObject, model: type[VirtualInstrument]) -> None:
    """Whatever was sent, in whatever packets: the next question gets its answer, and only its answer."""
    link = Link(model, at_work=data.draw(st.booleans()))
    link.send(data.draw(conversations(model)), data.draw(_cuts))
    _in_step(link)


def survives_garbage(data: st.DataObject, model: type[VirtualInstrument]) -> None:
    """Bytes that were never meant as messages raise nothing and leave the link usable."""
    link = Link(model, at_work=data.draw(st.booleans()))
    link.send(b"\n".join(data.draw(st.lists(garbage, min_size=1, max_size=8))), data.draw(_cuts))
    _in_step(link)


def packets_do_not_matter(data: st.DataObject, model: type[VirtualInstrument]) -> None:
    """One stream in one piece, byte by byte or in any packets: the same replies."""
    lines = data.draw(st.lists(_line(model), min_size=1, max_size=4))
    stream = b"".join(line + b"\n" for line in lines)
    at_work = data.draw(st.booleans())
    whole, parts = Link(model, at_work=at_work), Link(model, at_work=at_work)
    whole.send(stream)
    cuts = data.draw(st.one_of(_cuts, st.just(list(range(len(stream))))))
    parts.send(stream, _not_behind_blocks(stream, cuts))
    assert parts.replies == whole.replies
    assert _state(parts, model) == _state(whole, model)


def spellings_do_not_matter(data: st.DataObject, model: type[VirtualInstrument]) -> None:
    """Long, short or mixed case, chained or one by one: the same replies and the same state."""
    chain = data.draw(st.lists(statements(model).filter(_not_about_replies), min_size=1, max_size=6))
    at_work = data.draw(st.booleans())
    plain, fancy = Link(model, at_work=at_work), Link(model, at_work=at_work)
    for statement in chain:
        plain.send(canonical(statement) + b"\n")
    fancy.send(data.draw(spelled(chain)) + b"\n", data.draw(_cuts) if not _has_block(chain) else ())
    assert _without_quoted_input(fancy.replies) == _without_quoted_input(plain.replies)
    assert _state(fancy, model) == _state(plain, model)


def _without_quoted_input(replies: list[bytes]) -> bytes:
    """The replies in one piece; behind the semicolon of an error's text stands what was sent, in its own spelling."""
    return _DETAIL.sub(rb'\1"', b";".join(replies))


def blocks_hold_any_bytes(data: st.DataObject, model: type[VirtualInstrument]) -> None:
    """What was uploaded is read back bit by bit, and what follows the block is read as what it is."""
    link = Link(model)
    payload = data.draw(st.binary(min_size=1, max_size=300))
    cuts = data.draw(_cuts)
    if model is VirtualAwg70002a:
        link.send(b'WLIS:WAV:NEW "m",%d\n' % len(payload))
        link.send(b'WLIS:WAV:MARK:DATA "m",' + _framed(data, payload) + b"\n", cuts)
        assert link.ask(b'WLIS:WAV:MARK:DATA? "m"') == [b"#%d%d" % (len(str(len(payload))), len(payload)) + payload]
    elif model is VirtualAlp:
        link.send(b"ALP:DEVALLOC\nALP:SEQALLOC 1,1\n")
        link.replies.clear()
        link.send(b"ALP:SEQPUT 1,0,1," + _framed(data, payload) + b"\n", cuts)
        assert len(link.replies) == 1
    else:
        link.send(b"*ESE " + _framed(data, payload) + b"\n", cuts)
    _in_step(link)


PROPERTIES: dict[str, Property] = {
    found.__name__: found
    for found in (
        stays_in_step,
        survives_garbage,
        packets_do_not_matter,
        spellings_do_not_matter,
        blocks_hold_any_bytes,
    )
}


def _line(model: type[VirtualInstrument]) -> st.SearchStrategy[bytes]:
    chains = st.lists(statements(model), min_size=1, max_size=3)
    lines = chains.flatmap(spelled)
    return lines if model.COMMANDS else st.one_of(lines, laser_texts())


def _framed(data: st.DataObject, payload: bytes) -> bytes:
    digits = data.draw(st.integers(len(str(len(payload))), 9))
    return b"#%d" % digits + str(len(payload)).rjust(digits, "0").encode() + payload


def _not_about_replies(statement: Statement) -> bool:
    """Not `*STB?`, which tells whether a reply waits, nor a wait for a curve, which only a device clear ends here.

    One message and several answer these differently, as they should.
    """
    return statement.nodes[0][0] not in ("*STB", "CURVENext", "CURVEStream", "WAVFRMStream")


def _has_block(chain: list[Statement]) -> bool:
    return any(spellings[0].startswith(b"#") for statement in chain for spellings in statement.arguments)


def _not_behind_blocks(stream: bytes, cuts: list[int]) -> list[int]:
    """No cut where a block may just have ended: there, bytes that come later begin a new message, by design."""
    return [] if b"#" in stream else cuts


def _in_step(link: Link) -> None:
    link.finish()
    assert link.ask(b"*OPC?") == [b"1"]
    if isinstance(link.instrument, VirtualAlp):
        link.ask(b"ALP:DEVALLOC")
        assert link.ask(INQUIRY) == [b"0,13042"]
    assert link.ask(b"*CLS;*OPC?") == [b"1"]


def _state(link: Link, model: type[VirtualInstrument]) -> list[list[bytes]]:
    """Everything that can be asked without an argument, and the codes of the errors."""
    link.finish()
    state = [link.ask(b"*ESR?"), link.ask(b"*OPC?")]
    for command in model.COMMANDS:
        asked = command.header.replace("[", "").replace("]", "")
        if command.answers and command.acts and "#" not in asked:
            state.append(link.ask(asked.encode() + b"?"))
    return [*state, *[link.ask(asked) for asked in (b"SYST:ERR:CODE:ALL?", b"EVENT?", b"EVQTY?")]]
