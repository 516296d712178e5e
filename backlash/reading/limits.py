"""The rules by which a log is read, in one table: each limit with its unit and its reason.

What is refused, left out, filled or averaged on the way from stamps to a record of constant speed.
"""

# Files.
MOST_BYTES = 64 * 2**20  # of a log, packed or not
MOST_STYLE_TAGS = 100_000  # of a workbook's parts but its sheets and texts: some seconds
MOST_CELLS = 8_000_000  # of a table: an hour at 500 Hz of four columns
MOST_COLUMNS = 4096
MOST_LOGS = 100_000  # of a table of logs: the parent holds 3 kB for each

# Time stamps.
MOST_HZ = 1e6  # no logger samples faster; the stamps have another unit
SINCE_1970_S = (1e9, 4e9)  # from 2001 to 2096
# What misses more than both is a gap; less is filled, a fifth of the ring's period at most.
LONGEST_STEP = 3.5  # in sampling periods
LONGEST_FILLED_S = 0.010
FEW_GAPS = 0.02  # of the steps; more are bursts or lost samples
MOST_INVENTED = 0.1  # of the samples; above, the stamps are not those of the samples

LEAST_NAMES = 100  # of signals; a table that names fewer, row after row, has a row for each value

# Samples in a period of the ring.
LEAST_RATE = 4  # with half as many, two of 17 simulated joints were wrong
GOOD_RATE = 12  # with fewer, the samples may miss more than 3 % of a peak
FASTEST_HZ = 2000.0  # above, neighbouring samples are averaged

# The movement.
LEAST_RATIO = 0.9  # motor turns in a load turn; 1 for the joint's side
FASTEST_RPS = 500.0  # of a motor, 30000 rpm; above, the unit is another one
LEAST_SAMPLES = 8  # of a log, and of a load turn
LEAST_TURNS = 4  # fewer half turns have too few orders of signs to tell a pattern from noise
MOST_TURNS = 60  # what is beyond adds nothing but time
# Of a speed beside the one that was said, and of turns alike; backlash disturbs it by some 1 %.
TOLERANCE = 0.03
MOST_DRIFT = 0.01  # of the mean of whole turns
SMOOTHING_S = 0.1  # two periods of the ring, a fraction of a turn

# Signals that are not those of a motor.
SPIKE = 0.3  # of the speed, within a sample: no motor's torque does that
STRAY = (
    3.0  # of the torque's range, and in medians of all deviations; an impact's single sample 1.2
)
STRAY_DEVIATIONS = 20.0
MOST_SINGLE = 0.01  # of the samples; more are no single ones
LEAST_FROZEN = 8  # samples of one value
LEAST_BENEATH = (
    2  # times that a coarse signal stands for half as long or longer, beside its longest
)
RARE = 0.01  # of the steps; smaller ones come from values that a logger filled in
LEAST_LEAP = 3.0  # in the finest steps; a coarse signal moves by one
LEAST_HELD = 0.25  # of the values, that stand more than one sample
LONGEST_HOLD = 50  # samples; what stands longer rests, or is frozen
MOST_REGULAR = 0.95
LEAST_VALUES = 16  # of a signal that is not merely coarse
# Samples at a limit over those at a level beside it; of a sine that is rounded 2.4 at most.
LEAST_PILED = 4.0
MOST_CLIPPED = 0.005  # of the samples, at a limit three or more in a row
