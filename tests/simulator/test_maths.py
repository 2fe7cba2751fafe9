"""The engine's own elementary functions."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROGRAM = r"""
#include <cmath>
#include <cstdio>
#include "maths.hpp"
using namespace cogless;
int main() {
    std::uint64_t s = 1;
    const auto random = [&] {
        s = s * 6364136223846793005U + 1442695040888963407U;
        return double(s >> 11U) * 0x1p-53;
    };
    double worst[4] = {};
    const auto note = [](double& w, long double error) { w = std::fmax(w, double(std::fabs(error))); };
    for (int n = 0; n < 200000; ++n) {
        const double x = (2.0 * random() - 1.0) * std::pow(10.0, 9.0 * random() - 0.4);
        note(worst[0], unit_vector(x).re - cosl(x));
        note(worst[0], unit_vector(x).im - sinl(x));
        const double y = -60.0 * random(), z = std::exp(80.0 * random() - 40.0);
        note(worst[1], exponential(y) / expl(y) - 1.0L);
        note(worst[2], (logarithm(z) - logl(z)) / std::fmax(1e-3L, std::fabs(logl(z))));
    }
    bool floors = true;
    for (double x : {-1e300, -1e16, -2.5, -2.0, -1e-300, -0.0, 0.0, 0.3, 7.0, 4503599627370495.5}) {
        floors &= round_down(x) == std::floor(x);
    }
    for (int n = 0; n < 1000; ++n) {
        const double x = (random() - 0.5) * std::pow(10.0, 20.0 * random());
        floors &= round_down(x) == std::floor(x);
    }
    for (double x : {1e-8, 0.5, 3.0, 20.0, 100.0}) {
        const auto j = bessel_j(150, x);
        for (std::size_t n = 0; n < j.size(); ++n) note(worst[3], j[n] - jn(int(n), x));
    }
    std::printf("%g %g %g %g %g %g %d\n", worst[0], worst[1], worst[2], worst[3],
                exponential(-800.0), exponential(-1.0 / 0.0), floors);
}
"""


@pytest.mark.skipif(shutil.which("c++") is None, reason="no C++ compiler")
def test_elementary_functions_against_long_double(tmp_path: Path) -> None:
    (tmp_path / "maths.cpp").write_text(PROGRAM)
    command = [
        *os.environ.get("CXX", "c++").split(),
        "-std=c++20",
        "-O2",
        "-ffp-contract=off",
        f"-I{ROOT / 'simulator'}",
    ]
    subprocess.run([*command, str(tmp_path / "maths.cpp"), "-o", str(tmp_path / "maths")], check=True)
    made = subprocess.run([tmp_path / "maths"], capture_output=True, text=True, check=True)
    cos_sin, exponential, logarithm, bessel, small, none, floors = map(float, made.stdout.split())
    assert cos_sin < 2e-15
    assert exponential < 5e-16
    assert logarithm < 5e-16
    assert bessel < 1e-14
    assert small == none == 0.0
    assert floors == 1
