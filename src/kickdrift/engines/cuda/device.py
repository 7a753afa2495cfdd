"""The device: whether there is one, and its memory."""

from __future__ import annotations

from numba import config, cuda

from kickdrift.errors import InputError

ABSENT = "engine 'cuda': no graphics processor answers"
GO_ON = "without --engine cuda the run is on this machine's processor"


def check_device() -> None:
    """Refuse a machine without a device or its driver."""
    config.CUDA_LOW_OCCUPANCY_WARNINGS = 0  # a system of few particles has few blocks
    try:
        if cuda.is_available():
            cuda.current_context()
            return
        reason = "numba-cuda finds no driver or no device"
    except Exception as error:  # the driver's own errors, of several classes
        reason = " ".join(str(error).split())[:200]
    raise InputError(f"{ABSENT}: {reason}; {GO_ON}")


def check_room(n: int, bytes_each: float) -> None:
    """Refuse more particles than fit into the free memory of the device."""
    if config.ENABLE_CUDASIM:
        return
    free, _ = cuda.current_context().get_memory_info()
    if n * bytes_each > free:
        raise InputError(
            f"engine 'cuda': {n:,} particles need {n * bytes_each / 2**30:.1f} GiB, and the device has "
            f"{free / 2**30:.1f} GiB free; about {int(free / bytes_each):,} particles fit"
        )


def failure(error: Exception, n: int) -> InputError | None:
    """The error for a user of what the driver refuses for n particles; None for another error."""
    text = " ".join(str(error).split())[:200]
    if "OUT_OF_MEMORY" in text:
        return InputError(f"engine 'cuda': the memory of the device is too small for {n:,} particles; {GO_ON}")
    if "CUDA_ERROR" in text or "cudadrv" in type(error).__module__:
        return InputError(f"engine 'cuda': the driver refuses numba-cuda's code and may be too old: {text}; {GO_ON}")
    return None


def processors() -> int:
    """Number of the device's multiprocessors."""
    return 1 if config.ENABLE_CUDASIM else int(cuda.get_current_device().MULTIPROCESSOR_COUNT)
