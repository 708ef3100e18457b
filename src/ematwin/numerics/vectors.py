"""How wide the vectors of the processor are."""

import os
from functools import cache


@cache
def doubles_in_a_vector() -> int:
    """Numbers in double precision that a vector holds: 8 with AVX-512, else taken to be 4.

    NUMBA_CPU_FEATURES counts, as it does for what numba compiles.
    """
    given = os.environ.get("NUMBA_CPU_FEATURES")
    features = host_features() if given is None else given
    return 8 if "+avx512f" in features.split(",") else 4


def host_features() -> str:
    """What this processor can, as LLVM names it; nothing where LLVM does not know."""
    import llvmlite.binding as llvm

    try:
        return str(llvm.get_host_cpu_features().flatten())
    except RuntimeError:
        return ""
