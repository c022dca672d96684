"""The virtual generator's state after reset, its marker levels, errors and system commands."""

from sim_backends.virtual import VirtualAwg70002a
from tests.sim_backends.virtual.awg70002a.session import errors, start
from tests.sim_backends.virtual.watched import Ask, Watched


def test_waiting_values(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "OUTP2:WVAL:ANAL FIRS;MARK2 FIRS")
    assert ask(awg, "OUTP2:WVAL:ANAL?;MARK2?;:OUTP1:WVAL:ANAL?") == b"FIRS;FIRS;ZERO"
    ask(awg, "OUTP1:SVAL:ANAL:STAT OFF;:OUTP1:SVAL:MARK1 OFF;:OUTP1:WVAL:MARK1 HIGH")
    assert ask(awg, "OUTP1:SVAL:ANAL?;MARK1?;:OUTP1:WVAL:MARK1?") == b"OFF;OFF;HIGH"
    assert ask(awg, "OUTP1:SVAL?;SVAL:STAT?;MARK1:STAT?") == b"OFF;OFF;OFF"


def test_error_queue_overflow(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "NONSENSE\n" * 40)
    assert ask(awg, "SYST:ERR:COUN?") == b"32"
    assert errors(ask, awg).split(",")[-1] == "-350"


def test_reset_state(ask: Ask, awg: VirtualAwg70002a) -> None:
    start(ask, awg)
    ask(awg, "TRIG:LEV 0.5,BTR;:TRIG:SLOP NEG;:TRIG:MODE SYNC;:TRIG:IMP 1000")
    assert ask(awg, "TRIG:LEV? BTR;LEV?;SLOP?;MODE?;IMP?") == b"5.0000000000E-01;1.4000000000E+00;NEG;SYNC;1000"
    ask(awg, "*RST")
    for query, reply in {
        "CLOC:SRAT?": "2.5000000000E+10",
        "CLOC:SOUR?": "INT",
        "SOUR1:RMOD?": "CONT",
        "OUTP1?": "0",
        "SOUR1:DAC:RES?": "10",
        "SOUR1:VOLT?": "5.0000000000E-01",
        "SOUR1:VOLT:LEV:IMM:HIGH?": "2.5000000000E-01",
        "SOUR1:VOLT:LOW?": "-2.5000000000E-01",
        "OUTP1:PATH?": "DIR",
        "SOUR1:TINP?": "ATR",
        "TRIG:LEV? BTR": "1.4000000000E+00",
        "TRIG:SLOP?": "POS",
        "TRIG:IMP?": "50",
        "TRIG:MODE?": "ASYN",
        "TRIG:SOUR?": "EXT",
        "OUTP1:WVAL:ANAL:STAT?": "ZERO",
        "OUTP1:WVAL:MARK1?": "LOW",
        "OUTP1:SVAL:ANAL:STAT?": "ZERO",
        "CLOC:JITT?": "0",
        "SLIS:SIZE?": "0",
        "SOUR1:MARK1:VOLT:HIGH?": "1.0000000000E+00",
        "SOUR1:MARK2:VOLT:LOW?": "0.0000000000E+00",
        "SOUR1:MARK1:VOLT?": "1.0000000000E+00",
        "SOUR1:MARK1:VOLT:OFFS?": "5.0000000000E-01",
        "SOUR1:SKEW?": "0.0000000000E+00",
        "INST:MODE?": "AWG",
        "WLIS:SIZE?": "0",
        "AWGC:CONF:CNUM?": "2",
        "SYST:ERR:DIAL?": "1",
    }.items():
        assert ask(awg, query).decode() == reply, query


def test_marker_levels_as_amplitude_and_offset(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "SOUR1:MARK1:VOLT 0.6;VOLT:OFFS 0.2")
    assert ask(awg, "SOUR1:MARK1:VOLT:HIGH?;LOW?") == b"5.0000000000E-01;-1.0000000000E-01"
    assert errors(ask, awg) == "0"


def test_an_error_text_that_holds_a_line_end(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "OUTPUT1:PATH DCA")
    assert ask(awg, "*ESR?") == b"16"
    assert ask(awg, "SYST:ERR?") == b'-222,"Data out of range;Data Out of Range - OUTPUT1:PATH DCA\r\n"'
    ask(awg, "OUTPUT1:PATH DIR")
    assert errors(ask, awg) == "0"


def test_system_tree(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    assert ask(awg, "SYST:VERS?") == b"1999.0"
    assert ask(awg, "SYST:DATE?") == b"2024,01,01"
    assert ask(awg, "*OPT?") == b"03,225"
    ask(awg, "SYST:DATE 2026,2,3")
    assert ask(awg, "SYST:DATE?") == b"2026,02,03"
    ask(awg, "SYST:TIME 10,20,30;:SYST:DATE 2026,2,31")
    assert ask(awg, "SYST:TIME?") == b"10,20,30"
    assert errors(ask, awg) == "-222"
    world.clock.advance(60.0)
    minutes = int(ask(awg, "SYST:TIME?").split(b",")[1])
    world.clock.advance(60.0)
    assert int(ask(awg, "SYST:TIME?").split(b",")[1]) == (minutes + 1) % 60


def test_the_self_test_takes_minutes(ask: Ask, awg: VirtualAwg70002a, world: Watched) -> None:
    assert ask(awg, "*TST?") == b"0"
    assert world.clock.now >= 120.0


def test_what_an_earlier_user_left_survives_until_it_is_set_anew(ask: Ask, awg: VirtualAwg70002a) -> None:
    left = {
        "TRIG:SOUR": "INT",
        "TRIG:MODE": "SYNC",
        "TRIG:IMP": "1000",
        "SOUR1:SKEW": "1.0000000000E-10",
        "SOUR1:MARK1:DEL": "5.0000000000E-11",
        "CLOC:SOUR": "EFIX",
        "CLOC:EREF:FREQ": "1.0000000000E+08",
        "OUTP2": "1",
        "INST:MODE": "FGEN",
    }
    for header, value in left.items():
        ask(awg, f"{header} {value}")
    ask(awg, "OUTP:OFF 1;OFF 0;:AWGC:STOP;*CLS")
    assert {header: ask(awg, f"{header}?").decode() for header in left} == left


def test_the_root_may_be_left_out_and_means_channel_1(ask: Ask, awg: VirtualAwg70002a) -> None:
    ask(awg, "VOLT 0.3;:FREQ 1e9;:TINP BTR;:RMOD TRIG;:SKEW 1e-10;:DAC:RES 8;:MARK2:DEL 5e-11;VOLT:HIGH 1.2;LOW 0.1")
    assert ask(awg, "SOUR1:VOLT?;TINP?;RMOD?;DAC:RES?") == b"3.0000000000E-01;BTR;TRIG;8"
    assert ask(awg, "SOUR:MARK2:DEL?;VOLT:LOW?;HIGH?") == b"5.0000000000E-11;1.0000000000E-01;1.2000000000E+00"
    assert ask(awg, "CLOC:SRAT?;:FREQ:CW?;:SOUR1:FREQ:FIX?") == b";".join(3 * [b"1.0000000000E+09"])
    assert ask(awg, "SOUR2:VOLT?;TINP?") == b"5.0000000000E-01;ATR"
    assert errors(ask, awg) == "0"
    ask(awg, "MARK3:DEL 0;:VOLT3 0.3;:RCC 1;:RCC3 1")
    assert errors(ask, awg) == "-114,-113,-113"
