"""A second reader of a run's file, written from docs/file-format.md alone: h5py, NumPy and the standard library."""

from __future__ import annotations

import hashlib
import json
import zlib

import h5py
import numpy as np

KNOWN_SCHEMA = 2


def read(path):
    """All that the page promises of a file, in true units, as one dictionary of arrays, texts and numbers."""
    with h5py.File(path, "r") as file:
        own, particles = file["kickdrift"], file["particles/trajectory"]
        assert list(file["h5md"].attrs["version"]) == [1, 1]
        if own.attrs["schema"] > KNOWN_SCHEMA:
            raise ValueError("a newer schema")
        frames, samples, events = own["committed"][()]
        units = dict(own["units"].attrs)
        length, time = units["length_factor"], units["time_factor"]
        assert particles["position/value"].attrs["unit"] == "Angstrom"
        assert particles["velocity/value"].attrs["unit"] == "Angstrom ps-1"
        assert particles["position/time"].attrs["unit"] == "ps"
        found = {
            "steps": particles["position/step"][:frames],
            "times": particles["position/time"][:frames] / time,
            "positions": particles["position/value"][:frames].astype("f8") / length,
            "velocities": particles["velocity/value"][:frames].astype("f8") / (length / time),
            "masses": particles["mass"][()],
            "ids": particles["id"][()],
            "dtype": particles["position/value"].dtype,
            "compressed": particles["position/value"].compression == "gzip",
            "units": units,
            "every": own.attrs["every"],
            "run_id": own.attrs["run_id"],
            "source": own["system/source"][()].decode(),
            "record": json.loads(own["system/record"][()]),
            "method": json.loads(own["method"][()]),
            "versions": json.loads(own["versions"][()]),
            "start": own["system/phase"][()],
            "plan": own["plan"][()],
            "sample_steps": own["samples/step"][:samples],
            "sample_times": own["samples/time"][:samples],
        }
        boundary = [each.decode() for each in particles["box"].attrs["boundary"]]
        found["box"] = None
        if boundary == ["periodic"] * 3:
            edges = particles["box/edges/value"][:frames] / length
            assert (edges == edges[0]).all()
            found["box"] = edges[0]
        if "image" in particles:
            found["positions"] += particles["image/value"][:frames] * found["box"]
        if "force" in particles:
            found["forces"] = particles["force/value"][:frames].astype("f8") / units["force_factor"]
        names = {number: name for name, number in h5py.check_enum_dtype(particles["species"].dtype).items()}
        found["species"] = [names[number] for number in particles["species"][()]]
        found["observables"] = {name: group["value"][:frames] for name, group in file["observables"].items()}
        for group in [*(file["observables"][name] for name in found["observables"]), particles["velocity"]]:
            assert np.array_equal(group["step"][:frames], found["steps"])
        found["samples"] = {
            name: data[:samples] for name, data in own["samples"].items() if name not in ("step", "time")
        }
        found["units_of"] = {name: own["samples"][name].attrs["unit"] for name in found["samples"]}
        found["report"] = json.loads(bytes(own["report"][()])) if own["closed"][0] else None
        found["events"] = [_event(own["events"], row) for row in range(events)]
        found["checkpoints"] = _checkpoints(own["checkpoints"])
        assert _sha256(own["system"], particles) == own["system"].attrs["sha256"]
        return found


def _event(table, row):
    distance, energy = table["distance"][row], table["energy"][row]
    return {
        "time": table["time"][row],
        "step": table["step"][row],
        "ids": [int(each) for each in table["ids"][row] if each != -1],
        "distance": None if np.isnan(distance) else distance,
        "energy": None if np.isnan(energy) else energy,
        "kind": table["kind"][row].decode(),
        "done": table["done"][row].decode(),
    }


def _checkpoints(table):
    """Step and time of each; their bytes are those that were written."""
    count, begin = table["committed"][0], 0
    for row in range(count):
        end = table["end"][row]
        assert zlib.crc32(table["data"][begin:end].tobytes()) == table["crc32"][row]
        begin = end
    return list(zip(table["step"][:count].tolist(), table["time"][:count].tolist(), strict=True))


def _sha256(system, particles):
    digest = hashlib.sha256(system["record"][()])
    digest.update(system["phase"][()].astype("<f8").tobytes())
    for name, kind in (("mass", "<f8"), ("id", "<i8"), ("species", "<i4")):
        digest.update(particles[name][()].astype(kind).tobytes())
    return digest.hexdigest()
