"""The gallery of the site: a thumbnail of each picture, with the page that shows it and the script that draws it."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import NamedTuple

TOP = Path(__file__).parents[1]
WIDTH = 360  # pixels of a thumbnail


class Shown(NamedTuple):
    """A picture: file from the top of the checkout or name of a notebook, caption, page that it leads to."""

    picture: str
    caption: str
    page: str


LIQUIDS = (
    Shown("docs/assets/two-worlds.png", "A Lennard-Jones liquid, and asteroids after 300 years", "index.md"),
    Shown("docs/view.png", "A mixture and the planets in a browser", "view.md"),
    Shown("structure_and_diffusion", "Structure and diffusion of a liquid", "notebooks/structure_and_diffusion.md"),
    Shown("heat_baths", "Four heat baths and the exact distribution", "notebooks/heat_baths.md"),
    Shown("crystals", "Equation of state and elastic constants", "notebooks/crystals.md"),
    Shown("melting_lines", "Melting lines of copper and silicon", "notebooks/melting_lines.md"),
    Shown("own_potential", "A potential of your own", "notebooks/own_potential.md"),
    Shown("docs/lj_energy_error.png", "Energy errors of a liquid", "textbooks.md"),
    Shown("validation/figures/ensemble_pressures.png", "Pressures from ensembles of replicas", "report.md"),
    Shown("docs/own-forces.png", "One run under each kind of force", "your-own-force.md"),
)
ORBITS = (
    Shown("docs/assets/planets.png", "Orbits and elements of planets", "solar-system.md"),
    Shown("solar_system", "The solar system over a thousand years", "notebooks/solar_system.md"),
    Shown("resonances", "Secular frequencies and the resonance of Neptune and Pluto", "notebooks/resonances.md"),
    Shown("close_encounters", "Planets that meet", "notebooks/close_encounters.md"),
    Shown("docs/periodic-orbits.png", "Periodic orbits of two and three bodies", "orbits.md"),
    Shown("docs/megno-map.png", "A map of chaos around Saturn", "ensembles.md"),
)
EQUATIONS = (
    Shown("first_hour", "A spring, Lorenz' attractor and the growth of an error", "notebooks/first_hour.md"),
    Shown("chaos_maps", "Order and chaos by Hénon and Heiles", "notebooks/chaos_maps.md"),
    Shown("stiff_chemistry", "Robertson's stiff reactions", "notebooks/stiff_chemistry.md"),
)
METHODS = (
    Shown("lj_benchmark", "Energy errors with and without a jump at the cutoff", "notebooks/lj_benchmark.md"),
    Shown("own_integrator", "Methods of your own beside shipped ones", "notebooks/own_integrator.md"),
    Shown("choosing_an_integrator", "Error against work", "notebooks/choosing_an_integrator.md"),
    Shown("validation/figures/kepler_energies.png", "Energies of Kepler's problem", "report.md"),
    Shown("validation/figures/shadow_hamiltonian.png", "The energy that a symplectic method keeps", "report.md"),
    Shown("docs/speed.png", "Speed beside other programs", "speed.md"),
)
SECTIONS = {"Liquids and solids": LIQUIDS, "Planets and stars": ORBITS, "Equations": EQUATIONS, "Methods": METHODS}


def gallery(pictures: dict[str, bytes]) -> tuple[str, dict[str, bytes]]:
    """Page in Markdown, and its thumbnails by file name. ``pictures`` are the last pictures of notebooks by name; a
    notebook that was not executed has none and is left out."""
    parts = ["# Gallery", "Each picture leads to the page or notebook with the lines that draw the picture."]
    thumbnails: dict[str, bytes] = {}
    for title, rows in SECTIONS.items():
        lines = []
        for each in rows:
            whole = pictures.get(each.picture)
            if each.picture.endswith(".png"):
                whole = (TOP / each.picture).read_bytes()
            if whole is None:
                continue
            name = f"thumbnails/{Path(each.picture).stem}.png"
            thumbnails[name] = thumbnail(whole)
            lines.append(f"-   [![{each.caption}]({name})]({each.page})\n\n    {each.caption}")
        if lines:
            parts += [f"## {title}", '<div class="grid cards" markdown>', "\n\n".join(lines), "</div>"]
    return "\n\n".join(parts) + "\n", thumbnails


def thumbnail(picture: bytes) -> bytes:
    """The picture as a PNG file of WIDTH pixels."""
    from PIL import Image

    with Image.open(BytesIO(picture)) as whole:
        small = whole.convert("RGB")
        small.thumbnail((WIDTH, WIDTH))
        content = BytesIO()
        small.save(content, format="PNG", optimize=True)
    return content.getvalue()
