"""What sets an MSO64B apart from other oscilloscopes: its digitiser, its rates, its memory.

Source: 6 Series B MSO data sheet, recalled where nothing else is said. The family has 12 bits up to 25 GS/s, on every
channel, and 8 bits at 50 GS/s, on two; the latter are not simulated.
"""

from sim_backends.virtual.oscilloscope.horizontal import Records

BITS = 12  # in the upper bits of 16: "12 bit precision data is zero padded in lower 4 bits" (ACQuire:MODe)
BANDWIDTH_HZ = 10e9
RECORDS = Records(
    rates=tuple(25e9 / 2**octave for octave in range(16)),  # the steps below 25 GS/s assumed
    shortest=1000,
    longest=62_500_000,
)
