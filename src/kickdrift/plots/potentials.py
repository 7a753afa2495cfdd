"""Figure of a file of a potential: energies of crystals over the lattice constant, and tables of embedded atoms."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from kickdrift.analysis.crystals.potential import PotentialFile, potential_file
from kickdrift.forces import EmbeddedAtom
from kickdrift.plots.drawing import COLOURS, Figure, checked_target, legend, new_axes, new_figure, save_figure

STYLES = ("-", "--", ":", "-.")
ROOM = 3.0  # energies up to the depth of the crystal over this, above zero, are drawn


def plot_potential(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    numbers: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
) -> Path:
    """Draw a file of a potential, and on request write the figure's numbers: see `potential_figure`. Return the
    figure's path."""
    target = checked_target(output, overwrite, path)
    return save_figure(potential_figure(potential_file(path)), target, numbers, overwrite)


def potential_figure(found: PotentialFile) -> Figure:
    """Energy of an atom against the distance of neighbours in each crystal; for embedded atoms also the densities and
    the embedding energies."""
    force = found.force
    panels = 3 if isinstance(force, EmbeddedAtom) else 1
    figure = new_figure(5.4 * panels, 4.4)
    axes = new_axes(figure, (1, panels, 1))
    for k, each in enumerate(found.crystals):
        colour = COLOURS[force.known.index(each.element) % len(COLOURS)]
        shown = each.energies < -each.energy / ROOM
        axes.plot(
            each.constants[shown], each.energies[shown], STYLES[k % len(STYLES)], color=colour,
            label=f"{each.element}, {each.kind}",
        )  # fmt: skip
    axes.set_xlabel("lattice constant (angstrom)")
    axes.set_ylabel("energy of an atom (eV)")
    axes.set_title(found.path.name)
    if found.crystals:
        legend(axes)
    if isinstance(force, EmbeddedAtom):
        held = force.potential
        of_distance, of_density = new_axes(figure, (1, panels, 2)), new_axes(figure, (1, panels, 3))
        for k, element in enumerate(held.elements):
            density, embedding = held.density[k, k, :, 3], held.embedding[k, :, 3]
            of_distance.plot(
                held.dr * np.arange(1, len(density) + 1), density, color=COLOURS[k % len(COLOURS)], label=element
            )
            at = held.first_density + held.drho * np.arange(len(embedding))
            of_density.plot(at, embedding, color=COLOURS[k % len(COLOURS)], label=element)
        of_distance.set_xlabel("distance (angstrom)")
        of_distance.set_ylabel("density at a neighbour")
        of_density.set_xlabel("density")
        of_density.set_ylabel("embedding energy (eV)")
        legend(of_distance)
        legend(of_density)
    return figure
