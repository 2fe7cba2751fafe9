"""Traces: names and units, windows, xarray and netCDF."""

import sys
from dataclasses import dataclass

import numpy as np
import pytest
import xarray

from cogless import StudyError
from cogless.results.trace import Trace, write_netcdf


@dataclass
class Run:
    scenario: str
    controller: str
    trace: Trace


def make(rows=101):
    time = np.arange(rows) / 100
    data = np.column_stack([time, 1e5 + time, 6 + 0 * time, 5 + 0 * time, 3 + 0 * time, 4 + 0 * time])
    return Trace(
        ("time", "theta_m", "omega_ref", "omega_m", "i_d", "i_q"),
        ("s", "rad", *["rad/s"] * 2, "A", "A"),
        data,
    )


def test_signals_are_views_with_units():
    trace = make()
    assert np.shares_memory(trace["omega_m"], trace.data)
    assert trace.unit("omega_m") == "rad/s" and trace.unit("i_amplitude") == "A"
    assert len(trace) == 101 and trace.period == pytest.approx(0.01)


def test_derived_signals():
    trace = make()
    assert np.all(trace["omega_error"] == 1)
    assert np.all(trace["i_amplitude"] == 5)
    assert "omega_error" in trace and "nothing" not in trace


def test_unknown_signal_names_those_there_are():
    with pytest.raises(KeyError, match="no signal 'speed'; there are time, theta_m, omega_ref"):
        make()["speed"]
    with pytest.raises(KeyError, match="no signal 'speed'"):
        make().unit("speed")


def test_window_includes_both_ends():
    trace = make()
    assert trace.window(0.2, 0.5) == slice(20, 51)
    assert trace.window(0.195, 0.205) == slice(20, 21)
    assert trace.window(-1, 9) == slice(0, 101)
    assert trace.window(3, 2) == slice(101, 101) and trace.window(0.5, 0.2) == slice(50, 50)
    # up to rounding, a millionth of a row
    assert trace.window(0.2 + 0.9e-8, 0.5 - 0.9e-8) == slice(20, 51)
    assert trace.window(0.2 + 1.1e-8, 0.5 - 1.1e-8) == slice(21, 50)


def test_the_period_is_the_mean_time_between_rows():
    assert make(1).period == 0.0 == make(0).period and make(2).period == 0.01
    assert make(101).period == 0.01


def test_blocks_are_all_of_the_rows_in_order():
    assert list(make().blocks(slice(10, 35), 10)) == [slice(10, 20), slice(20, 30), slice(30, 35)]
    assert list(make(20).blocks(size=10)) == [slice(0, 10), slice(10, 20)] and list(make(0).blocks()) == []


def test_what_is_as_large_as_the_largest_reads_as_not_a_number():
    for worst in (10.0, -10.0, np.inf, -np.inf, np.nan):
        data = np.column_stack([np.arange(3.0), [9.9, worst, -9.9]])
        assert np.array_equal(
            Trace(("time", "x"), ("s", ""), data, largest=10.0)["x"], [9.9, np.nan, -9.9], equal_nan=True
        )


def test_shape_must_fit():
    with pytest.raises(ValueError, match="for 1 names"):
        Trace(("time",), ("s",), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="for 2 names, 1 units"):
        Trace(("time", "x"), ("s",), np.zeros((3, 2)))


def test_names_and_units_are_the_trace_s_own():
    names, units = ["time", "omega"], ["s", "rad/s"]
    trace = Trace(names, units, np.zeros((3, 2)))
    names[1], units[1] = "theta", "rad"
    assert trace.names == ("time", "omega") and trace.units == ("s", "rad/s")


def test_to_xarray():
    data = make().to_xarray()
    assert data.omega_m.attrs["units"] == "rad/s"
    assert data.time.attrs["units"] == "s"
    assert float(data.omega_m.sel(time=0.5, method="nearest")) == 5


def test_without_xarray_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(StudyError, match=r"^to_xarray: expected xarray \(pip install 'cogless\[xarray\]'\)$"):
        make().to_xarray()


def test_netcdf_has_one_group_for_each_run(tmp_path):
    path = tmp_path / "traces.nc"
    write_netcdf(
        path, [Run("low", "pi", make()), Run("low", "ilc", make(11)), Run("high", "pi", make())], {"seed": 3}
    )
    with xarray.open_dataset(path, group="low/ilc") as data:
        assert data.sizes == {"time": 11}
        assert data.theta_m.dtype == np.float64 and data.omega_m.dtype == np.float32
        assert data.omega_m.attrs["units"] == "rad/s"
        np.testing.assert_array_equal(data.theta_m, make(11)["theta_m"])
        np.testing.assert_array_equal(data.omega_ref, 6)
    with xarray.open_dataset(path, group="high/pi") as data:
        assert data.sizes == {"time": 101}
    assert xarray.open_dataset(path).attrs["seed"] == 3
    assert [file.name for file in tmp_path.iterdir()] == ["traces.nc"]


@pytest.mark.parametrize(("rate", "every"), [(100.0, 1), (99.0, 2), (50 * (1 - 1e-9), 2), (1e9, 1)])
def test_netcdf_has_rows_at_no_more_than_the_rate(tmp_path, rate, every):
    write_netcdf(tmp_path / "traces.nc", [Run("low", "pi", make())], rate=rate)
    with xarray.open_dataset(tmp_path / "traces.nc", group="low/pi") as data:
        assert data.attrs["every"] == every
        np.testing.assert_allclose(data.time, make()["time"][::every])


def test_netcdf_is_whole_or_absent(tmp_path):
    def runs():
        yield Run("low", "pi", make())
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_netcdf(tmp_path / "traces.nc", runs())
    assert list(tmp_path.iterdir()) == []
