"""Papers by name: which questions are asked of each, and the run that answers them all."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dqreg.errors import InputError
from dqreg.papers.accuracy import accuracy_section, measure_accuracy
from dqreg.papers.convergence import convergence_section, measure_convergence
from dqreg.papers.directions import directions_section, measure_directions
from dqreg.papers.document import Report, Section
from dqreg.papers.examples import examples_section, measure_examples
from dqreg.papers.integration import integration_section, measure_orders
from dqreg.papers.interpolation import interpolation_section, measure_interpolation
from dqreg.papers.jacobians import jacobians_section, measure_jacobians
from dqreg.papers.registration import measure_registration, registration_section
from dqreg.papers.solution_time import measure_time, time_section
from dqreg.papers.table3 import CHOICES, TRIALS, measure_table3, table3_section
from dqreg.papers.weights import measure_weights, weights_section

# From a source of draws and whether few trials will do, to one answered question.
Question = Callable[[np.random.Generator, bool], Section]


@dataclass(frozen=True, slots=True)
class Paper:
    """One paper."""

    title: str  # Heading of the page
    citation: str  # Authors, title, where and when
    questions: tuple[Question, ...]  # Each makes one section
    figures: tuple[str, ...]  # Keys of the figures that they make, known before the work


PAPERS: dict[str, Paper] = {
    "walker1991": Paper(
        "Walker, Shao and Volz (1991), reproduced",
        'M. W. Walker, L. Shao, R. A. Volz, "Estimating 3-D location parameters using dual number quaternions", CVGIP: '
        "Image Understanding 54 (1991).",
        (
            lambda rng, quick: table3_section(measure_table3(rng, *((4, 5) if quick else (CHOICES, TRIALS)))),
            lambda rng, quick: directions_section(measure_directions(rng, *((4, 50) if quick else (20, 1000)))),
            lambda rng, quick: weights_section(measure_weights(rng, *((3, 100) if quick else (10, 2000)))),
            lambda rng, quick: time_section(measure_time(rng, *((500, 2) if quick else (100_000, 15)))),
            lambda rng, quick: accuracy_section(measure_accuracy(rng, 5 if quick else 100)),
        ),
        ("directions", "weights", "time"),
    ),
    "jia2020": Paper(
        "Jia's notes on quaternions (2020), reproduced",
        'Y.-B. Jia, "Quaternions", notes for Com S 477/577, Iowa State University, 3 September 2020.',
        (
            lambda rng, quick: examples_section(measure_examples()),
            lambda rng, quick: registration_section(measure_registration(rng, 40 if quick else 2000)),
            lambda rng, quick: convergence_section(
                measure_convergence(rng, *((300, 2_000) if quick else (2_000, 20_000)))
            ),
            lambda rng, quick: interpolation_section(measure_interpolation()),
            lambda rng, quick: integration_section(measure_orders()),
            lambda rng, quick: jacobians_section(measure_jacobians(rng, 20 if quick else 200)),
        ),
        ("icp", "interpolation", "integration"),
    ),
}


def reproduce(
    paper: str, seed: int = 0, *, quick: bool = False, observe: Callable[[Section], object] | None = None
) -> Report:
    """Answer all questions of one paper."""
    if paper not in PAPERS:
        raise InputError(f"paper must be one of {sorted(PAPERS)}; got {paper!r}")
    if seed < 0:
        raise InputError(f"seed must be 0 or more; got {seed}")
    chosen, sections = PAPERS[paper], []
    for number, question in enumerate(chosen.questions):
        # Each question draws for itself, so that a change of one leaves the others' numbers alone.
        section = question(np.random.default_rng([seed, number]), quick)
        if observe is not None:
            observe(section)
        sections.append(section)
    return Report(paper, chosen.title, chosen.citation, seed, quick, tuple(sections), _versions())


def _versions() -> dict[str, str]:
    from importlib.metadata import version

    packages = {name: version(name) for name in ("numpy", "scipy", "matplotlib", "jinja2")}
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    return {
        "dqreg": version("dqreg"),
        "Python": platform.python_version(),
        **packages,
        "machine": machine,
    }
