// Rounding to the unit of a fixed-point pose: of the amount that a target adds, as a function of the target's weight
// alone, so that sums do not depend on the history; or once, of the sum over all targets.

// Rounds what is in 2^-16 of units: GPUs read half of a register, or shift and add at once. The half does not overflow.
#define ROUNDED(value) ((value) + 0x8000 >> 16)
