"""The control library's structs, as read from its headers, are those that a compiler sees."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from control_library import HEADERS, SOURCE, control_library
from hypothesis import given, settings
from hypothesis import strategies as st

from cogless.c_layout import Layout, control_layout
from cogless.control_library import Field, Headers, Status, control_headers, parse
from cogless.study import drive, linear_plant
from cogless.study.laws import harmonic, pi_afc, space

CONFIGS = sorted(name for name in control_headers().structs if name.endswith("_config"))
PLAIN = {"bool": st.booleans(), "uint32_t": st.integers(0, 2**32 - 1)}


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
    kind, method = values["memory"]["kind"], values["memory"]["method"]
    assert (kind, method) == ("CGL_MEMORY_ANGLE", "CGL_DELAY_INVERSION")


def test_a_pointer_is_none_and_what_follows_it_is_right(headers: Headers) -> None:
    control = control_library("float")
    config = control.new("cgl_trial_config")
    config.learning_matrix, config.limit = control.ffi.cast("cgl_real *", 0x1234), 30.0
    data = bytes(control.ffi.buffer(config))
    values = Layout(headers, "f").decode("cgl_trial_config", data)
    assert (values["learning_matrix"], values["limit"]) == (None, 30.0)


def test_another_size_is_refused(headers: Headers) -> None:
    with pytest.raises(ValueError, match="cgl_pi_config: 8 bytes: expected 12"):
        Layout(headers, "f").decode("cgl_pi_config", bytes(8))


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


def values_of(headers: Headers, name: str, width: int) -> st.SearchStrategy[Any]:
    """Anything that a type of the library can hold."""

    def member(field: Field) -> st.SearchStrategy[Any]:
        if field.pointer:
            return st.none()
        one = values_of(headers, field.type, width)
        return one if field.length is None else st.lists(one, min_size=field.length, max_size=field.length)

    if name in headers.structs:
        return st.fixed_dictionaries({field.name: member(field) for field in headers.structs[name]})
    if name in headers.enums:
        return st.sampled_from(list(headers.enums[name]))
    return st.floats(width=width, allow_nan=False) if name == "cgl_real" else PLAIN[name]


@pytest.mark.parametrize("precision", ["single", "double"])
@settings(max_examples=40)
@given(data=st.data())
def test_a_configuration_goes_through_its_bytes(precision: str, data: st.DataObject) -> None:
    layout, width = control_layout(precision), 32 if precision == "single" else 64
    assert {"cgl_drive_config", "cgl_trial_config", "cgl_space_position_config"} < set(CONFIGS)
    name = data.draw(st.sampled_from(CONFIGS))
    values = data.draw(values_of(layout.headers, name, width))
    assert layout.decode(name, layout.pack(name, values)) == values


PI = {"kp": 0.1, "ki": 2.0, "limit": 4.0}
MEMORY = {"kind": "CGL_MEMORY_TIME", "channels": 1, "cells": 8, "turns": 1, "parts": 1, "q_half_width": 0,
          "lead": 0, "forgetting": 1.0, "limit": [1.0], "method": "CGL_DELAY_ODE", "k_pp": 0.0}  # fmt: skip


def test_numbers_are_those_of_a_cast() -> None:
    """To float, rounded once, to the nearest; what a short list leaves open is zero."""
    control = control_library("float")
    data = control_layout("single").pack("cgl_pi_config", PI)
    assert data == bytes(control.ffi.buffer(control.new("cgl_pi_config", **PI)))
    zeros = control.ffi.new("cgl_feedforward_config *", {"numerator": 2, "num": [0.1, 0.2]})
    values = {"numerator": 2, "denominator": 0, "preview": 0, "num": [0.1, 0.2], "den": ()}
    data = control_layout("single").pack("cgl_feedforward_config", values)
    assert data == bytes(control.ffi.buffer(zeros))


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("cgl_pi_config", {**PI, "kd": 0.0}, r"cgl_pi_config\.kd: unknown"),
        ("cgl_pi_config", {"kp": 0.1, "ki": 2.0}, r"cgl_pi_config\.limit: missing"),
        ("cgl_pi_config", {**PI, "kp": 1e39}, r"cgl_pi_config\.kp: 1e\+39: expected a value of cgl_real"),
        ("cgl_pi_config", {**PI, "kp": None}, r"cgl_pi_config\.kp: None: expected a value of cgl_real"),
        ("cgl_pi_config", {**PI, "kp": True}, r"cgl_pi_config\.kp: True: expected a value of cgl_real"),
        ("cgl_memory_config", {**MEMORY, "cells": -1}, r"cells: -1: expected a value of uint32_t"),
        ("cgl_memory_config", {**MEMORY, "cells": 1 << 32}, r"4294967296: expected a value of uint32_t"),
        ("cgl_memory_config", {**MEMORY, "cells": 8.0}, r"cells: 8\.0: expected a value of uint32_t"),
        ("cgl_memory_config", {**MEMORY, "kind": "time"},
            r"kind: 'time': expected a value of cgl_memory_kind"),
        ("cgl_memory_config", {**MEMORY, "kind": 1}, r"kind: 1: expected a value of cgl_memory_kind"),
        ("cgl_pi_ilc_config", {"pi": {**PI, "ki": "1 ms"}, "gain": 0, "memory": MEMORY},
            r"cgl_pi_ilc_config\.pi\.ki: '1 ms'"),
    ],
)  # fmt: skip
def test_what_no_member_holds_is_refused(name: str, values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        control_layout("single").pack(name, values)


def test_an_array_holds_no_more_than_its_length() -> None:
    values = {"order": 0, "odd": False, "b": [1.0] * 6, "a": []}
    with pytest.raises(ValueError, match=r"cgl_zero_phase_config\.b: 6 entries: expected at most 5"):
        control_layout("single").pack("cgl_zero_phase_config", values)


def with_fields(fields: tuple[Field, ...]) -> Layout:
    headers = control_headers()
    return Layout(replace(headers, structs={**headers.structs, "cgl_pi_config": fields}), "f")


def test_a_member_that_moves_in_the_header_moves_in_the_bytes() -> None:
    kp, ki, limit = control_headers().structs["cgl_pi_config"]
    layout = control_layout("single")
    moved = with_fields((ki, kp, limit)).pack("cgl_pi_config", PI)
    assert moved == layout.pack("cgl_pi_config", {**PI, "kp": PI["ki"], "ki": PI["kp"]})


def test_a_member_of_another_name_in_the_header_is_noticed() -> None:
    """And so is a new one: the mapping from the study has to give it."""
    kp, *others = control_headers().structs["cgl_pi_config"]
    for fields in ((replace(kp, name="k_p"), *others), (kp, replace(kp, name="k_p"), *others)):
        with pytest.raises(ValueError, match=r"cgl_pi_config\.k_p: missing|cgl_pi_config\.kp: unknown"):
            with_fields(fields).pack("cgl_pi_config", PI)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"limitt": 4.0}, r"cgl_pi_config\.limitt: unknown"),
        ({"b": 1.0, "a": 2.0}, r"cgl_pi_config\.a: unknown"),
        ({"limit": None, "a": 2.0}, r"cgl_pi_config\.a: unknown"),
        ({"limit": None, "z": 2.0}, r"cgl_pi_config\.limit: missing"),
    ],
)
def test_of_several_wrong_members_the_first_is_told(change: dict[str, float | None], told: str) -> None:
    values = {name: value for name, value in {**PI, **change}.items() if value is not None}
    with pytest.raises(ValueError, match=f"^{told}$"):
        control_layout("single").pack("cgl_pi_config", values)


def test_what_a_pointer_points_to_is_not_in_the_bytes() -> None:
    layout = control_layout("single")
    values = layout.decode("cgl_trial_config", bytes(layout.size("cgl_trial_config")))
    assert layout.pack("cgl_trial_config", values) == bytes(layout.size("cgl_trial_config"))
    with pytest.raises(ValueError, match=r"^cgl_trial_config\.learning_matrix: expected None, since it is a"):
        layout.pack("cgl_trial_config", {**values, "learning_matrix": 1})


@pytest.mark.parametrize(
    ("macro", "number"),
    [
        ("HARMONIC_ORDERS", harmonic.HARMONIC_ORDERS),
        ("HARMONIC_ORDER_MAX", harmonic.HARMONIC_ORDER_MAX),
        ("HARMONIC_EDGES", 2 * harmonic.HARMONIC_BANDS),
        ("HARMONIC_FASTEST", harmonic.ORDER_ANGLE_MOST),
        ("PI_AFC_ORDERS", pi_afc.PI_AFC_ORDERS),
        ("PI_AFC_ORDER_MAX", pi_afc.PI_AFC_ORDER_MAX),
        ("ENCODER_TABLE_ORDERS", drive.ENCODER_TABLE_ORDERS),
        ("TRIAL_STATES", linear_plant.TRIAL_STATES),
        ("ANGLE_MAX", space.ANGLE_MAX),
    ],
)
def test_what_a_study_may_ask_for_is_what_the_library_can_hold(macro: str, number: float) -> None:
    text = "\n".join(path.read_text() for path in (SOURCE / "cogless").glob("*.h"))
    (found,) = re.findall(rf"^#define CGL_{macro} (?:CGL_R\()?([\d.e]+)", text, re.MULTILINE)
    assert float(found) == number


def test_bits_of_a_status_are_the_library_s() -> None:
    text = (SOURCE / "cogless" / "status.h").read_text()
    bits = {name: int(bit) for name, bit in re.findall(r"CGL_STATUS_(\w+) = (\d+)", text)}
    assert bits == {str(each.name): each.value for each in Status}
