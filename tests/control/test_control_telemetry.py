"""The snapshot that an interrupt writes and a background task reads whole."""

import pytest
from control_library import control_library


@pytest.fixture
def telemetry():
    library = control_library("float")
    state = library.new("cgl_telemetry")
    library.lib.cgl_telemetry_reset(state)
    return library, state


def write(library, state, number: float) -> None:
    drive, out = library.new("cgl_drive"), library.new("cgl_drive_output")
    drive.monitor.theta_m = drive.monitor.omega_m = getattr(drive, "in").omega_ref = drive.currents.u_dc = (
        number
    )
    for name in ("i_d", "i_q", "i_d_ref", "i_q_ref", "u_d", "u_q"):
        setattr(out, name, number)
    out.status = int(number)
    library.lib.cgl_telemetry_write(state, drive, out)


def read(library, state) -> tuple[bool, set[float], int]:
    snapshot = library.new("cgl_snapshot")
    done = library.lib.cgl_telemetry_read(state, snapshot)
    names = [name for name, _ in library.ffi.typeof("cgl_snapshot").fields if name != "count"]
    return done, {getattr(snapshot, name) for name in names}, snapshot.count


def test_the_newest_snapshot_is_read_with_all_of_its_numbers(telemetry) -> None:
    library, state = telemetry
    assert not read(library, state)[0]
    for n in range(1, 6):
        write(library, state, float(n))
        assert read(library, state) == (True, {float(n)}, n)
        assert read(library, state) == (True, {float(n)}, n)


def test_the_count_runs_round(telemetry) -> None:
    library, state = telemetry
    state.count = 2**32 - 2
    write(library, state, 7.0)
    assert read(library, state) == (True, {7.0}, 2**32 - 1)
    write(library, state, 8.0)
    assert read(library, state) == (True, {8.0}, 2)


def test_what_is_half_written_is_not_given_out(telemetry) -> None:
    """A writer that stopped in the buffer that is read: not possible on one core, and seen all the same."""
    library, state = telemetry
    write(library, state, 1.0)
    state.buffer[1].count = 3
    assert not read(library, state)[0]
