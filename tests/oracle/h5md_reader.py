"""A second reader of a run's file, written from docs/file-format.md alone: h5py, NumPy and the standard library."""

from __future__ import annotations

import hashlib
import json
import zlib

import h5py
import numpy as np

KNOWN_SCHEMA = 2


def read(path):
    """Everything that the page promises of a file, in true units, as one dictionary of arrays, texts and numbers."""
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
        if "periodic" in boundary:
            found["box"] = particles["box/edges/value"][:frames] / length
            assert found["box"].shape[1:] in ((3,), (3, 3))
            for key in ("step", "time"):
                assert np.array_equal(particles["box/edges"][key][:frames], particles["position"][key][:frames])
        if "image" in particles:
            for position, image, edges in zip(found["positions"], particles["image/value"], found["box"], strict=False):
                position += image @ (edges if edges.ndim == 2 else np.diag(edges))
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
        assert _sha256_of_all(own, particles) == own.attrs["sha256"]
        found["damaged"] = _damaged(file, own["checksums"], frames, samples, events)
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
    """Step and time of each checkpoint, after a check of its bytes."""
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


def _sha256_of_all(own, particles):
    units = own["units"].attrs
    texts = [own[name].asstr()[()] for name in ("system/record", "system/source", "method", "versions")]
    digest = hashlib.sha256("".join(f"{text}\0" for text in texts).encode())
    keys = ("name", "length", "time", "mass", "energy", "temperature", "boltzmann", "gravity", "light", "coherent_mass")
    for key in (*keys, "nominal", "length_factor", "time_factor", "force_factor"):
        if key in units:
            digest.update(f"{key}\0".encode())
            value = units[key]
            digest.update(
                f"{value}\0".encode() if isinstance(value, str) else np.float64(value).astype("<f8").tobytes()
            )
    digest.update(np.int64(own.attrs["every"]).astype("<i8").tobytes())
    for each in particles["box"].attrs["boundary"]:
        digest.update(each + b"\0")
    names = h5py.check_enum_dtype(particles["species"].dtype)
    for name in sorted(names, key=names.get):
        digest.update(f"{name}\0".encode())
    digest.update(f"{particles['mass'].attrs['unit']}\0".encode())
    for array in (own["system/phase"], particles["mass"], particles["id"], particles["species"]):
        data = array[()].tobytes()
        for first in range(0, len(data), 8192):
            digest.update(_sum(data[first : first + 8192]).to_bytes(8, "little"))
    return digest.hexdigest()


def _damaged(file, sums, frames, samples, events):
    """Numbers of the damaged frames, samples and events."""
    particles, own = file["particles/trajectory"], file["kickdrift"]
    names = list(sums.attrs.get("observables", ()))
    block = sums.attrs["particles"]
    clock = [particles["position/step"], particles["position/time"]]
    clock += [particles["box/edges/value"]] if "edges" in particles["box"] else []
    found = {"frames": [], "samples": [], "events": []}
    for row in range(frames):
        expected = [_checksum(clock, row)]
        expected.append(_checksum([file[f"observables/{name}/value"] for name in names], row) if names else 0)
        for name in ("position", "velocity", "force", "image"):
            if name in particles:
                values = particles[name]["value"][row]
                blocks = range(0, len(values), block)
                expected += [_checksum([values[np.newaxis, first : first + block]], 0) for first in blocks]
        found["frames"] += [row] if list(sums["frame"][row]) != expected else []
    series = [own["samples"][name] for name in ("step", "time", *names)]
    found["samples"] = [row for row in range(samples) if sums["sample"][row] != _checksum(series, row)]
    columns = [own["events"][name] for name in ("time", "step", "ids", "distance", "energy", "kind", "done")]
    found["events"] = [row for row in range(events) if sums["event"][row] != _checksum(columns, row)]
    return found


def _checksum(columns, row):
    return _sum(b"".join(column[row : row + 1].tobytes() for column in columns))


def _sum(data):
    """Checksum in Python's own integers, which cannot overflow."""
    words = np.frombuffer(data.ljust(-(-len(data) // 8) * 8, b"\0"), "<u8").tolist()
    total = 1
    for i, word in enumerate(words):
        z = (i + 1) * 0x9E3779B97F4A7C15 % 2**64
        total += ((z ^ z >> 32) | 1) * word
    return total % 2**64
