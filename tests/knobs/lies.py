"""The lies: what an instrument may give, from one moment of a run on, without a word."""

from dataclasses import dataclass

from sim_backends.faults.catalogue import IDENTITY, PICTURE_LIES, SOURCE_LIES, TRACE_LIES, Fault, Moment
from tests.knobs.interloper import VisitedBench

ALWAYS = 10**6
BEFORE = "before the run"
MIDDLE, INSIDE = "between records", "between channels"


@dataclass(frozen=True)
class Lie:
    """One fault that nobody is told of.

    Attributes:
        role: the instrument.
        name: for people.
        fault: what it does.
        moment: the message from which on it does it, counted from `when`.
        when: the moment of a run, as of a setting that is changed; None: there is none.
        when_burst: that of a burst run.
        harmless: no record depends on it.
    """

    role: str
    name: str
    fault: Fault
    moment: Moment
    when: str | None = MIDDLE
    when_burst: str | None = MIDDLE
    harmless: bool = False

    @property
    def answered(self) -> bool:
        """Whether every instrument goes on answering."""
        return self.harmless

    def befalls(self, bench: VisitedBench) -> None:
        """It waits for its message from now on."""
        bench.befall(self.role, self.fault, self.moment)


LIES = (
    *(
        Lie(role, name, fault, Moment("*IDN?", 1, ALWAYS), BEFORE, BEFORE)
        for role in ("scope", "awg", "laser", "patch_panel")
        for name, fault in IDENTITY.items()
        if (role, name) not in (("scope", "the oscilloscope"), ("awg", "the generator"))
    ),
    *(Lie("scope", name, fault, Moment()) for name, fault in TRACE_LIES.items()),
    *(
        Lie("scope", f"{name} from the beginning", TRACE_LIES[name], Moment(), BEFORE, BEFORE)
        for name in ("one channel frozen", "one channel zero", "one behind", "scale zero", "scale doubled")
    ),
    Lie("scope", "source unheard once", SOURCE_LIES["source unheard"], Moment("DATa:SOUrce"), INSIDE, INSIDE),
    Lie("scope", "source unheard", SOURCE_LIES["source unheard"], Moment("DATa:SOUrce", 1, ALWAYS)),
    Lie("dmd", "picture taken, not shown", PICTURE_LIES["picture not shown"], Moment("ALP:SEQPUT"), MIDDLE, None),
    Lie(
        "dmd",
        "pictures taken, not shown",
        PICTURE_LIES["picture not shown"],
        Moment("ALP:SEQPUT", 2, ALWAYS),
        MIDDLE,
        None,
    ),
    Lie("dmd", "starts nothing once", PICTURE_LIES["picture not shown"], Moment("ALP:PROJSTARTCONT"), MIDDLE, None),
    Lie(
        "dmd", "starts nothing", PICTURE_LIES["picture not shown"], Moment("ALP:PROJSTARTCONT", 1, ALWAYS), MIDDLE, None
    ),
    Lie("dmd", "burst starts nothing", PICTURE_LIES["picture not shown"], Moment("ALP:PROJSTART", 1, ALWAYS), None),
    Lie("dmd", "picture before", PICTURE_LIES["picture before"], Moment(), MIDDLE, None),
    Lie("dmd", "pictures before from the beginning", PICTURE_LIES["picture before"], Moment(), BEFORE, BEFORE),
    Lie("dmd", "mirrors stuck", PICTURE_LIES["mirrors stuck"], Moment()),
)
"""Every lie of the table, in its order."""
