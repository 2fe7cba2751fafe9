"""A header in C with a cogging table and its interpolation, for firmware of one's own and for SimpleFOC."""

from __future__ import annotations

import numpy as np

from cogless.c_literals import array
from cogless.drives.adapter import Adapter, Certainty, Feature, TableFrame, TableText
from cogless.drives.firmware_laws import HeaderTable
from cogless.drives.holding_current import HoldingCurrent, samples

WAVE_ENTRIES = 8  # entries for a wave of the highest order
ENTRIES_LEAST, ENTRIES_MOST = 128, 4096
SHARE_CHECK = (
    "set COGGING_SHARE to 0.3f, then to -0.3f, each at a slow speed: the ripple falls with 0.3f and grows "
    "with -0.3f"
)

HEADER_TEXT = """\
{introduction}
#ifndef COGGING_FEED_FORWARD_H
#define COGGING_FEED_FORWARD_H

#include <math.h>

#define COGGING_ENTRIES {count}
#define COGGING_SHARE 1.0f /* 0.3f and -0.3f check the sign; 0.0f takes the table out */

/* A, peak; entry i is at i / COGGING_ENTRIES of a mechanical revolution, straight lines between. */
static const float cogging_table[COGGING_ENTRIES] = {{
{entries}
}};

/* The current that holds the rotor against its cogging, A, at an angle in rad, of any turn. */
static inline float cogging_feed_forward(float angle)
{{
    const float place = angle * (COGGING_ENTRIES / 6.28318530718f);
    if (!(fabsf(place) < 1.0e9f)) {{
        return 0.0f; /* no number, or beyond all angles */
    }}
    const float whole = floorf(place);
    const float share = place - whole;
    const unsigned first = (unsigned)(int)whole % COGGING_ENTRIES; /* it is a power of two */
    const unsigned next = (first + 1U) % COGGING_ENTRIES;
    return COGGING_SHARE * (cogging_table[first] + share * (cogging_table[next] - cogging_table[first]));
}}

#endif
"""
OWN_INTRODUCTION = """\
// Cogging feed-forward, by cogless. The angle is the rotor's, mechanical, in the frame of its source: for a
// folder of cogless identify that of the logs, positive where a positive i_q turns the rotor.
//
// In the current loop's or the speed loop's step:
//     i_q_ref += cogging_feed_forward(theta_m);"""


def header(
    current: HoldingCurrent, frame: TableFrame, *, introduction: str, install: str, note: str
) -> TableText:
    """The header, and what its user does with it. `introduction`: its first lines, comments."""
    entries_wanted = WAVE_ENTRIES * max(current.orders)
    count = int(np.clip(1 << (entries_wanted - 1).bit_length(), ENTRIES_LEAST, ENTRIES_MOST))
    entries = np.asarray(samples(current, count, frame.direction, "linear"), dtype=np.float32)
    table = HeaderTable(entries.tolist())
    return TableText(
        HEADER_TEXT.format(introduction=introduction, count=count, entries=array(entries, "f")),
        count,
        "float, A",
        lambda angle: np.array([table.current(frame.direction * a) for a in angle.tolist()]),
        install=install,
        remove="#define COGGING_SHARE 0.0f in the header",
        sign_check=SHARE_CHECK,
        notes=(note,),
        table_params={"entries": table.entries},
    )


def write(current: HoldingCurrent, frame: TableFrame) -> TableText:
    """A header for firmware of one's own."""
    return header(
        current,
        frame,
        introduction=OWN_INTRODUCTION,
        install="#include FILE, and add cogging_feed_forward(theta_m) to i_q_ref",
        note="For a learning law with a table, use cogless export --to c.",
    )


C_TABLE = Adapter(
    name="c",
    title="a header in C",
    reads=(),
    writes=(Feature("table and cogging_feed_forward(angle), C99 or C++", Certainty.OWN),),
    write=write,
    own_angle=True,
)
