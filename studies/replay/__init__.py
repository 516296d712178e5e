"""What the runs that the authors stored in their notebook say of their protocol."""

# Misfits closer than this are the same generation of the same run: far above rounding.
AGREE_RPS = 1e-9
