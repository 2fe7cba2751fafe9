"""The control library's structs, as read from its headers, are those that a compiler sees."""

from __future__ import annotations

from pathlib import Path

import pytest
from control_library import HEADERS, SOURCE, control_library

from cogless.export.headers import Headers, parse
from cogless.export.layout import Layout


@pytest.fixture(scope="module")
def headers() -> Headers:
    return parse(SOURCE / "cogless" / name for name in HEADERS)


@pytest.mark.parametrize(("precision", "real"), [("float", "f"), ("double", "d")])
def test_every_struct_has_the_compilers_size_and_offsets(headers: Headers, precision: str, real: str) -> None:
    ffi, layout = control_library(precision).ffi, Layout(headers, real)
    assert {"cgl_drive_config", "cgl_trial_config", "cgl_drive_output"} < set(headers.structs)
    for name, fields in headers.structs.items():
        assert layout.size(name) == ffi.sizeof(name), name
        offsets = {field.name: offset for field, offset in layout._offsets(name)}
        assert offsets == {field.name: ffi.offsetof(name, field.name) for field in fields}, name


@pytest.mark.parametrize(("precision", "real"), [("float", "f"), ("double", "d")])
def test_bytes_come_back_as_the_values_that_went_in(headers: Headers, precision: str, real: str) -> None:
    control = control_library(precision)
    config = control.new("cgl_space_position_config")
    config.ratio, config.hand_over, config.index = 50, True, 1
    config.k_theta, config.memory.limit = 0.1, [1.5, 2.5, 0.1]
    config.memory.method = 1
    data = bytes(control.ffi.buffer(config))
    values = Layout(headers, real).decode("cgl_space_position_config", data)
    assert (values["ratio"], values["hand_over"], values["index"]) == (50, True, "CGL_SPACE_BY_ROTOR")
    assert values["k_theta"] == config.k_theta
    assert values["memory"]["limit"] == list(config.memory.limit)
    assert (values["memory"]["kind"], values["memory"]["method"]) == ("CGL_SPACE_MAP", "CGL_DELAY_INVERSION")


def test_a_pointer_is_none_and_what_follows_it_is_right(headers: Headers) -> None:
    control = control_library("float")
    config = control.new("cgl_trial_config")
    config.learning_matrix, config.limit = control.ffi.cast("cgl_real *", 0x1234), 30.0
    data = bytes(control.ffi.buffer(config))
    values = Layout(headers, "f").decode("cgl_trial_config", data)
    assert (values["learning_matrix"], values["limit"]) == (None, 30.0)


def test_another_size_is_refused(headers: Headers) -> None:
    with pytest.raises(ValueError, match="cgl_pi_config: 12 bytes: expected 16"):
        Layout(headers, "f").decode("cgl_pi_config", bytes(12))


def test_leaves_are_every_number_with_its_place(headers: Headers) -> None:
    leaves = Layout(headers, "f").leaves("cgl_drive_output")
    assert [leaf.path for leaf in leaves[:4]] == ["duty[0]", "duty[1]", "duty[2]", "i_d"]
    assert (leaves[-1].path, leaves[-1].format) == ("status", "I")
    assert [leaf.offset for leaf in leaves] == list(range(0, 4 * len(leaves), 4))


def test_comments_carry_the_units(headers: Headers) -> None:
    fields = {field.name: field for field in headers.structs["cgl_foc_config"]}
    assert fields["kp_d"].comment == "d-axis gains [V/A], [V/A/s], >= 0"
    assert fields["ki_d"].comment == "" and fields["ki_d"].declaration == fields["kp_d"].declaration
    assert fields["advance"].comment.startswith(
        "the voltage acts this many periods after sampling: 1.5 with one"
    )


def test_an_unknown_kind_of_member_is_said(tmp_path: Path) -> None:
    header = tmp_path / "odd.h"
    header.write_text("typedef struct {\n    unsigned bits : 3;\n} odd;\n")
    with pytest.raises(ValueError, match="odd: not readable"):
        parse([header])
