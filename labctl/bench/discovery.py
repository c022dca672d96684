"""Which instruments answer on this computer's buses and network, and what each one is for labctl."""

import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import pyvisa
from pyvisa.highlevel import get_wrapper_class, list_backends

from instruments.errors import InstrumentError, InstrumentInUse
from instruments.values import Identity
from instruments.visa import NoAnswer, VisaLink
from labctl.bench.drivers import installed

SERIAL = "ASRL"
PATIENCE_S = 1.0
"""How long an address may take to answer; those that nobody named are instruments or nothing."""
TERMINATORS = ("\n", "\r")
"""How messages end: as IEEE 488.2 says, or as on some lasers. Who hears no end does not answer."""


@dataclass(frozen=True)
class Answer:
    """An address at which somebody answers `*IDN?`; `instrument` and `driver` are empty where no driver is for it."""

    address: str
    identity: Identity
    instrument: str = ""
    driver: str = ""

    @property
    def who(self) -> str:
        """Who answers, in words."""
        return " ".join(part for part in vars(self.identity).values() if part)


def visible_addresses() -> tuple[str, ...]:
    """What VISA lists: on the network, USB, GPIB and serial ports, by pyvisa-py and by a vendor's library if any."""
    vendor = "ivi" in list_backends() and get_wrapper_class("ivi").get_library_paths()
    found: dict[str, None] = {}
    for backend in ("@py", "@ivi") if vendor else ("@py",):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of ways to search that are not installed, and sockets left to themselves
            found |= dict.fromkeys(pyvisa.ResourceManager(backend).list_resources("?*"))
    return tuple(found)


def answers_at(addresses: Iterable[str]) -> Iterator[Answer]:
    """Ask each address who is there; those that do not answer in time are left out. Nothing else is sent.

    Raises:
        InstrumentInUse: another program has an instrument for itself.
    """
    for address in dict.fromkeys(addresses):
        if (identity := _identity_at(address)) is not None:
            yield recognised(address, identity)


def _identity_at(address: str) -> Identity | None:
    for terminator in TERMINATORS:
        link = VisaLink(
            address,
            name="somebody",
            timeout_s=PATIENCE_S,
            transcript=lambda *_: None,
            write_eol=terminator,
            read_eol=terminator,
        )
        try:
            return Identity.parse(link.query("*IDN?"))
        except NoAnswer:
            continue
        except InstrumentInUse:
            raise
        except InstrumentError:
            break
        finally:
            link.close()
    return None


def recognised(address: str, identity: Identity) -> Answer:
    """What an instrument is for labctl, by its maker and model: of several drivers, the one that matches most of it."""
    maker_and_model = f"{identity.manufacturer} {identity.model}"
    known = [
        (match, driver.role, name)
        for name, driver in installed().items()
        if driver.identity is not None and (match := driver.identity.search(maker_and_model))
    ]
    if not known:
        return Answer(address, identity)
    _, instrument, name = max(known, key=lambda one: len(one[0][0]))
    return Answer(address, identity, instrument, name)
