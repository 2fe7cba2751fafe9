"""Results of `cogless design` for a study of trials: the plant, each controller's gains and certificate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cogless.design.margins import finite
from cogless.design.trials.certificate import Certificate, Learning, ModelCertificate
from cogless.design.trials.from_study import design_study, uncertain_plant
from cogless.design.trials.gains import TrialDesign
from cogless.design.trials.model import Model
from cogless.design.trials.polytope import UncertainPlant
from cogless.design.trials.prediction import PHASE_TRIALS, Prediction
from cogless.design.trials.random_errors import Amplification
from cogless.design.trials.state_feedback import Check
from cogless.study import TrialStudy

if TYPE_CHECKING:
    from rich.console import Group

NO_GAIN = 5e-5  # a largest K_3 up to this prints as "none", since it would print as zero

LEGEND = (
    "along the trial: magnitude of the loop's largest pole, stable below 1; one more sample: this magnitude "
    "with one more sample of delay at the input;\n"
    "from trial to trial: a trial multiplies the error by at most this factor at any frequency, for all "
    "vertices and random plants; filtered: this factor with the filter;\n"
    "contracting: the error shrinks at every frequency; monotone: it grows at none;\n"
    "with the ends: factor of the error from one tried trial to the next, with the filter if there is one;\n"
    "norm, power: norm of the map from one trial's learned signal to the next, and the largest norm of this "
    "map's powers;\n"
    "largest share: the largest ratio of a trial's error to the error without learning, for any error (with "
    "an observer: of missing inputs instead of errors);\n"
    "largest K_3: the largest K_3 with which no error grows, without the filter;\n"
    "share left: the share of the error without learning that is left at the end of a phase, at the worst "
    "corner of the ranges;\n"
    "trials to the floor: trials in each phase until the simulated plant's error is within a tenth of its "
    "floor;\n"
    "floor: the final RMS of the error, with the sensor's rounding;\n"
    "load noise, sensor noise: error by white noise with learning, divided by that without, at the worst "
    "corner of the ranges"
)


@dataclass(frozen=True)
class TrialSummary:
    """The plant that the study describes, and of each controller its design, or why it has none."""

    plant: UncertainPlant
    designs: dict[str, TrialDesign]
    without: dict[str, str]


def summary(study: TrialStudy) -> TrialSummary:
    """The design of each controller of a study, for the first scenario that it runs in.

    StudyError: no controller can be designed.
    """
    first: dict[str, str] = {}
    for scenario in study.scenario:
        for name in study.controllers_in(scenario):
            first.setdefault(name, scenario)
    designs = design_study(study, [(scenario, name) for name, scenario in first.items()])
    in_order = {
        name: designs[first[name], name] for name in study.controller if (first.get(name), name) in designs
    }
    if not designs and designs.without:
        raise next(iter(designs.without.values()))
    without = {name: why.text_without(study.source.path) for (_, name), why in designs.without.items()}
    return TrialSummary(uncertain_plant(study), in_order, without)


def to_dict(study: TrialStudy, summary: TrialSummary) -> dict[str, Any]:
    """The summary as plain types in SI units, for JSON. Models are discrete; frequency keys end in _Hz."""
    plant = summary.plant
    return {
        "study": study.title,
        "plant": {
            "order": plant.order,
            "relative_degree": plant.relative_degree,
            "period_s": plant.period,
            "discretisation": plant.discretisation,
            "C": plant.C.tolist(),
            "nominal": _model(plant.nominal),
            "vertices": [
                {"at": label, **_model(m)} for label, m in zip(plant.labels, plant.vertices, strict=True)
            ],
            "hull_of_the_corners": plant.exact_hull,
            "note": plant.note,
        },
        "controllers": {
            **{name: design_dict(design) for name, design in summary.designs.items()},
            **{name: {"not_designed": why} for name, why in summary.without.items()},
        },
    }


def design_dict(design: TrialDesign) -> dict[str, Any]:
    """A controller's gains, checks and certificate as plain types."""
    gains, ahead, q = design.gains, design.feedforward, design.q_filter
    return {
        "kind": design.kind,
        "K_s": [*design.K_1.tolist(), design.K_2],
        "K_1": design.K_1.tolist(),
        "K_2": design.K_2,
        "N": design.N,
        "dc_gain": 1 / design.N if design.N else None,
        "K_3": None if design.no_K_3 else design.K_3,
        "shift": design.shift,
        "learned_signal_into_the_integrator": design.through_integrator,
        "learns_by_a_matrix": design.learning_matrix is not None,
        "feedforward": ahead
        and {
            "method": ahead.method,
            "numerator": ahead.num.tolist(),
            "denominator": ahead.den.tolist(),
            "preview": ahead.preview,
        },
        "q_filter": q and {"b": q.b.tolist(), "a": q.a.tolist(), "acts_on": design.filtered},
        "observer": gains.observer
        and {"pole": gains.observer.pole, "response": gains.observer.response, "cutoff_Hz": gains.cutoff},
        "checks": {
            "state_feedback": gains.feedback and _check(gains.feedback.check, gains.feedback.status),
            "learning_gain": gains.learning
            and {
                **_check(gains.learning.check, gains.learning.status),
                "bounds": list(gains.learning.bounds),
                "mapped_set_affine": gains.learning.affine,
            },
        },
        "certificate": _certificate(design.certificate),
        "certified": design.certified,
        "amplification": design.amplification and _amplification(design.amplification),
        "scenario": _prediction(design),
        "notes": list(map(str, design.notes)),
    }


def verdict_line(design: TrialDesign) -> str:
    """The certificate's verdict on learning from trial to trial, in one line."""
    phrases = []
    for model, certificate in _certificate_rows(design.certificate):
        none = "no K_3" if design.no_K_3 else "no learning"
        does = verdict_words(certificate.learning) if certificate.learning else none
        phrases.append(f"{model} model: {does if certificate.stable else 'unstable along the trial'}")
    return f"the error's largest factor from trial to trial: {'; '.join(phrases)}"


def warnings(design: TrialDesign) -> list[str]:
    """The certificate of a controller in one line, as a warning before trials are run; empty if all is well.

    The design's notes have the changes that would help.
    """
    part = design.certificate.deciding
    fine = part.stable and (part.learning is None or part.learning.monotone)
    return [] if fine and design.no_K_3 is None else [verdict_line(design)]


def labelled_notes(study: TrialStudy, designs: Mapping[str, TrialDesign]) -> list[str]:
    """The notes of designs as sentences, each with the labels of its controllers in front.

    If there are several controllers, a note that all have is about plant or scenario, and gets no label.
    """
    owners: dict[str, list[str]] = {}
    for name, design in designs.items():
        for note in dict.fromkeys(map(str, design.notes)):
            owners.setdefault(note, []).append(study.label(name))
    return [
        f"{note}." if len(labels) == len(designs) > 1 else f"{'; '.join(labels)}: {note}."
        for note, labels in owners.items()
    ]


def _large(study: TrialStudy, summary: TrialSummary) -> Iterator[str]:
    """A sentence on each learning matrix: a microcontroller has to store all its numbers."""
    for name, design in summary.designs.items():
        size, flash = matrix_size(design), matrix_flash(study, design)
        if size and flash:
            yield f"{study.label(name)}: its learning matrix has {size} numbers: {megabytes(flash)} of flash."


def matrix_size(design: TrialDesign) -> str:
    """The shape of a design's learning matrix, such as "500 x 500"; "" if it has none."""
    return "" if design.learning_matrix is None else " x ".join(map(str, design.learning_matrix.shape))


def matrix_flash(study: TrialStudy, design: TrialDesign) -> int:
    """Bytes of a design's learning matrix in a drive's precision; 0 without a matrix, or without a drive."""
    if study.drive is None or design.learning_matrix is None:
        return 0
    return int(design.learning_matrix.size) * (8 if study.drive.precision == "double" else 4)


def megabytes(size: int) -> str:
    """A number of bytes as text, such as "1.00 MB"."""
    return f"{size / 1e6:.3g} MB"


def _certificate_rows(certificate: Certificate) -> Iterator[tuple[str, ModelCertificate]]:
    """Yields the kinds of models that a certificate covers: the design's, and exact ones if they differ."""
    of_design = {"euler": "Euler", "exact": "exact", None: "discrete"}[certificate.discretisation]
    yield of_design, certificate.design
    if certificate.exact is not None and certificate.discretisation != "exact":
        yield "exact", certificate.exact


def _model(model: Model) -> dict[str, Any]:
    return {"A": model.A.tolist(), "B": model.B[:, 0].tolist()}


def _check(check: Check, status: str) -> dict[str, Any]:
    return {
        "passed": check.passed,
        "smallest_eigenvalue_share": finite(check.smallest),
        "true_cost": finite(check.cost),
        "bound": finite(check.bound),
        "solver_says": status,
    }


def _certificate(certificate: Certificate) -> dict[str, Any]:
    return {
        "design_model": _models(certificate.design),
        "exactly_sampled": certificate.exact and _models(certificate.exact),
        "random_plants": certificate.samples,
        "decides": {"design": "design_model", "exact": "exactly_sampled"}[certificate.decides],
    }


def _prediction(design: TrialDesign) -> dict[str, Any] | None:
    """The scenario as it is predicted, at the corners and the nominal plant."""
    prediction = design.prediction
    if prediction is None:
        return None
    return {
        "plants": list(prediction.labels),
        "largest_share_of_the_feedback_s_error": finite(prediction.share),
        "trials_to_floor": list(prediction.trials_to_floor),
        "floor": [finite(floor) for floor in prediction.floor],
        "phases": [
            {
                "error_rms": phase.learned[:, -1].tolist(),
                "error_rms_without_learning": phase.feedback.tolist(),
                "sensor_steps_rms": phase.steps.tolist(),
                "sensor_steps_rms_without_learning": phase.feedback_steps.tolist(),
                "largest_input": phase.peak.tolist(),
                "largest_input_without_learning": phase.feedback_peak.tolist(),
                "random_part_of_the_error_rms": phase.random.tolist(),
                "random_part_without_learning": phase.feedback_random.tolist(),
            }
            for phase in prediction.phases
        ],
    }


def _amplification(amplification: Amplification) -> dict[str, Any]:
    """RMS of a random error in the long run / its RMS without learning, of each plant."""
    return {
        "plants": list(amplification.labels),
        "noise_on_the_load": [finite(x) for x in amplification.load],
        "noise_on_the_measurement": [finite(x) for x in amplification.noise],
    }


def _models(models: ModelCertificate) -> dict[str, Any]:
    return {
        "stable_along_the_trial": models.stable,
        "radius_along_the_trial": models.radius,
        "radius_at": models.worst,
        "stable_with_one_more_sample_of_delay": models.delayed_stable,
        "radius_with_one_more_sample_of_delay": models.delayed_radius,
        "radius_of_phi": models.phi_radius,
        "without_filter": models.without_filter and _learning(models.without_filter),
        "with_filter": models.with_filter and _learning(models.with_filter),
        "growth_with_the_trial_s_ends": models.growth,
        "finite_trial": models.finite
        and {
            "norm": finite(models.finite.norm),
            "largest_power": finite(models.finite.power),
            "largest_share_of_the_error": finite(models.finite.share),
            "share_of_the_error_that_remains": finite(models.finite.remains),
        },
    }


def _learning(learning: Learning) -> dict[str, Any]:
    return {
        "norm": finite(learning.norm),
        "norm_at_Hz": learning.frequency,
        "norm_at": learning.worst,
        "norm_of_the_nominal_plant": finite(learning.nominal),
        "monotone": learning.monotone,
        "contracting": learning.contracting,
        "largest_K_3": learning.K_3_limit,
    }


def plant_words(plant: UncertainPlant) -> str:
    """The plant in a sentence or two."""
    models = {None: "as given", "euler": "discretised by Euler", "exact": "discretised exactly"}
    count = len(plant.vertices)
    uncertain = f"Its uncertainty is spanned by {count} models, the vertices." if count > 1 else ""
    return (
        f"The plant has order {plant.order}, relative degree {plant.relative_degree} and a sample every "
        f"{1e3 * plant.period:g} ms ({models[plant.discretisation]}). {uncertain}"
    ).rstrip()


def table(study: TrialStudy, summary: TrialSummary) -> Group:
    """The plant in one line, a table of gains, a table of certificates, and notes."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    gains = Table(title=study.title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    for heading in ("controller", "K_s", "N", "K_3", "feedforward", "filter", "checked"):
        gains.add_column(heading, overflow="fold")
    proof = Table(title="Certificate", title_justify="left", title_style="bold", box=None, pad_edge=False)
    for heading in ("controller", "model", "along the trial", "one more sample", "from trial to trial"):
        proof.add_column(heading)
    for heading in ("filtered", "with the ends", "norm, power", "largest share", "largest K_3"):
        proof.add_column(heading)
    share = Table(title="This scenario", title_justify="left", title_style="bold", box=None, pad_edge=False)
    headings = ("share left", "trials to the floor", "floor", "largest input", "load noise", "sensor noise")
    for heading in ("controller", *headings, "learning"):
        share.add_column(heading)
    for name, design in summary.designs.items():
        gains.add_row(study.label(name), *gain_cells(design))
        for row in _proof(design.certificate):
            proof.add_row(study.label(name), *row)
    for name, design in summary.designs.items():
        if design.prediction is not None and design.learns:
            word = "certified" if design.certified else "not certified"
            share.add_row(study.label(name), *_in_scenario(design, design.prediction), word)
    for name in summary.without:
        gains.add_row(study.label(name), "not designed")
    lines = [Text(f"{study.label(name)}: not designed: {why}.") for name, why in summary.without.items()]
    lines += [
        Text(f"Note: {note}") for note in (*labelled_notes(study, summary.designs), *_large(study, summary))
    ]
    legend = Text(LEGEND, style="dim")
    tables = (part for table in (gains, proof, share) for part in (table, Text()))
    return Group(Text(plant_words(summary.plant)), Text(), *tables, legend, *lines)


def gain_cells(design: TrialDesign) -> tuple[str, ...]:
    """K_s, N, K_3, feedforward, filter, and whether the gains passed their check."""
    checks = [c.check for c in (design.gains.feedback, design.gains.learning) if c is not None]
    learning = "none" if design.no_K_3 else f"{design.K_3:.4f}" if design.K_3 else "-"
    learning = "matrix" if design.learning_matrix is not None else learning
    ahead, q = design.feedforward, design.q_filter
    gains = ", ".join(f"{gain:.4f}" for gain in (*design.K_1, design.K_2))
    observer, cutoff = design.gains.observer, design.gains.cutoff
    if observer is not None:
        gains = f"observer: pole {observer.pole:.2f}, response {observer.response:.4g}"
    return (
        gains,
        f"{design.N:.4f}",
        learning,
        f"{ahead.method}, {ahead.preview} ahead" if ahead else "-",
        f"order {len(q.b) - 1} on the {design.filtered}" + (f", {cutoff:.1f} Hz" if cutoff else "")
        if q
        else "-",
        (
            "by the rule"
            if observer
            else "given gains"
            if not checks
            else "yes"
            if all(c.passed for c in checks)
            else "no"
        ),
    )


def _floor(prediction: Prediction) -> tuple[str, str]:
    """The trials to the floor of each phase, and the floor."""
    trials = (f"> {PHASE_TRIALS}" if count is None else f"{count}" for count in prediction.trials_to_floor)
    return ", ".join(trials), ", ".join(f"{floor:.4g}" for floor in prediction.floor)


def _in_scenario(design: TrialDesign, prediction: Prediction) -> tuple[str, ...]:
    amplification = design.amplification
    noise = ("-", "-")
    if amplification is not None:
        worst = (max(amplification.load), max(amplification.noise))
        noise = (f"{worst[0]:.3f}", f"{worst[1]:.3f}")
    return f"{prediction.share:.4g}", *_floor(prediction), _most_input(design), *noise


def _most_input(design: TrialDesign) -> str:
    """The largest input that the scenario needs, and the plant where that is above the limit."""
    assert design.prediction is not None
    if design.over_limit is not None:
        plant, most_input = design.over_limit
        return f"{most_input:.4g} at {plant}, above the limit of {design.limit:.4g}"
    return f"{max(float(np.max(phase.peak)) for phase in design.prediction.phases):.4g}"


def _proof(certificate: Certificate) -> Iterator[tuple[str, ...]]:
    rows = list(_certificate_rows(certificate))
    for model, model_certificate in rows:
        plain, filtered = model_certificate.without_filter, model_certificate.with_filter
        limit = plain.K_3_limit if plain else None
        yield (
            f"{model}, decides" if len(rows) > 1 and model_certificate is certificate.deciding else model,
            f"{model_certificate.radius:.4f}" + ("" if model_certificate.stable else " unstable"),
            f"{model_certificate.delayed_radius:.3f}"
            + ("" if model_certificate.delayed_stable else " unstable"),
            verdict_words(plain),
            verdict_words(filtered),
            "-" if model_certificate.growth is None else f"{model_certificate.growth:.6g}",
            "-"
            if model_certificate.finite is None
            else f"{model_certificate.finite.norm:.4g}, {model_certificate.finite.power:.4g}",
            "-" if model_certificate.finite is None else f"{model_certificate.finite.share:.4g}",
            "-" if limit is None else f"{limit:.4f}" if abs(limit) > NO_GAIN else "none",
        )


def verdict_words(learning: Learning | None) -> str:
    """The largest factor from trial to trial, and what follows from it; "-" without learning."""
    if learning is None:
        return "-"
    word = "contracting" if learning.contracting else "monotone" if learning.monotone else "may grow"
    return f"{learning.norm:.6g} at {learning.frequency:.4g} Hz, {word}"
