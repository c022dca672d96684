"""What only a person can say of a run that is published: who made it, its title, by which rights it is given."""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression

from labctl.errors import UsageError
from labctl.printable import printable

LONGEST = 500
_PERSON = re.compile(r"(?P<name>[^<>]+?)\s*(?:<(?:https://orcid\.org/)?(?P<orcid>[^<>]*)>)?")
_ORCID = re.compile(r"(\d{4}-){3}\d{3}[\dX]")
_SPDX = re.compile(r"(?!(?i:licenseref-))[A-Za-z0-9.-]+")


@dataclass(frozen=True)
class Person:
    """Somebody: a name, and an ORCID such as 0000-0002-1825-0097, or empty."""

    name: str
    orcid: str = ""


@dataclass(frozen=True)
class Declaration:
    """What is said of what is published.

    Attributes:
        title: what it is called.
        creators: who made it, in their order.
        licence: an SPDX identifier, or the address of the text.
        publisher: who gives it away, empty if nobody said.
        description: in a few sentences, empty if nobody said.
    """

    title: str
    creators: tuple[Person, ...]
    licence: str
    publisher: str = ""
    description: str = ""

    @property
    def licence_url(self) -> str:
        """Where the text of the licence is."""
        return self.licence if self.licence.startswith("https://") else f"https://spdx.org/licenses/{self.licence}"


def declared(
    *, title: str, creators: Sequence[str], licence: str, publisher: str = "", description: str = ""
) -> Declaration:
    """What was said, as texts: creators as `Ada Lovelace` or `Ada Lovelace <0000-0002-1825-0097>`.

    Raises:
        UsageError: something is missing, which nobody here can make up, or is not what it should be.
    """
    needed = {"--title": title, "--creator": " ".join(creators), "--licence": licence}
    if missing := [option for option, said in needed.items() if not said.strip()]:
        raise UsageError(f"{' and '.join(missing)}: only you can say that: add it, such as {EXAMPLES[missing[0]]}")
    licence = _licence(licence)
    if too_long := [one for one in (title, publisher, *creators) if len(one) > LONGEST]:
        raise UsageError(f"{too_long[0][:40]}...: write {LONGEST} characters at most")
    texts = (printable(" ".join(one.split())) for one in (title, publisher, description))
    title, publisher, description = texts
    return Declaration(title, tuple(map(_person, creators)), licence, publisher, description)


EXAMPLES = {
    "--title": '--title "Digits on bench 2"',
    "--creator": '--creator "Ada Lovelace"',
    "--licence": "--licence CC-BY-4.0",
}


def _licence(text: str) -> str:
    """A licence by its address, or by its SPDX identifier as the address of its text spells it."""
    if re.fullmatch(r"https://\S+", text):
        return text
    with suppress(InvalidLicenseExpression):
        if _SPDX.fullmatch(text):
            return canonicalize_license_expression(text)
    raise UsageError(f"--licence {text}: name it by its SPDX identifier, such as CC-BY-4.0, or its https address")


def _person(text: str) -> Person:
    found = _PERSON.fullmatch(text.strip())
    orcid = "" if found is None else found["orcid"] or ""
    if found is None or ("<" in text and not _is_orcid(orcid)):
        raise UsageError(f'--creator {text}: write a name, or "Ada Lovelace <0000-0002-1825-0097>" with her ORCID')
    return Person(printable(" ".join(found["name"].split())), orcid)


def _is_orcid(text: str) -> bool:
    """Whether a text is an ORCID by its form and its last digit. Source: ISO 7064, MOD 11-2."""
    if not _ORCID.fullmatch(text):
        return False
    total = 0
    for digit in text.replace("-", "")[:-1]:
        total = (total + int(digit)) * 2
    return text[-1] == "0123456789X"[(12 - total % 11) % 11]
