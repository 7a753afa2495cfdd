"""Peaks of the machine, and the table of kernels with their share of the peaks."""

from docs.studies import peaks, predictions, roofline
from kickdrift_validation.performance import groups
from tests.folders import DOCS


def test_peaks_are_above_what_one_chain_and_memory_give():
    found = peaks.measure(turns=3, seconds=0.01)
    one_chain = 2 * 8 / found["fma_latency_ns"]
    assert found["fma_gflops"] > 1.5 * one_chain  # several chains run at a time
    assert found["L1_gb_per_s"] > 1.5 * found["memory_gb_per_s"] > 0.0


def test_every_kernel_has_a_row_with_its_share_of_the_peak():
    peaks = {"fma_gflops": 80.0, "fma_latency_ns": 1.5, "L1_gb_per_s": 250.0, "memory_gb_per_s": 10.0}
    found = {"processor": "one", "peaks": peaks, "nanoseconds": dict.fromkeys(roofline.KERNELS, 2.0)}
    rows = {row[0]: row for row in roofline.rows(found)}
    assert len(rows) == len(roofline.KERNELS)
    pair = rows["direct gravity, n = 1000"]
    assert pair[5:8] == ["18.0", "20", "22 %"]  # 36 operations and 40 bytes in 2 ns, against 80 per nanosecond
    text = roofline.tables_of(found)
    page = (DOCS / "roofline.md").read_text(encoding="utf-8")
    for name in rows:
        assert f"| {name} |" in text
        assert f"| {name} |" in page
    assert page.count(roofline.BEGIN) == page.count(roofline.END) == 1


def test_each_prediction_is_of_a_group_and_stands_beside_its_measurement():
    known = {entry.name: entry for entry in groups.ENTRIES}
    for each in predictions.PREDICTIONS:
        names = [contestant.name for contestant in known[each.group].contestants]
        assert each.ours in names
        assert any(name.startswith(each.against) for name in names)
    speeds = {"kickdrift": [9.0, 9.0], "LAMMPS omp": [2.0, 2.0], "LAMMPS plain": [1.0, 1.0]}
    group = {
        "name": "lj-1000000",
        "rows": [{"name": name, "version": "1", "speeds": row, "speed": row[0]} for name, row in speeds.items()],
        "left_out": [],
    }
    found = {"processor": "one", "cores": 2, "simd": "avx2", "turns": 2, "seconds": 1.0, "load_before": None}
    rows = predictions.rows(found | {"groups": [group]})
    assert rows[0][:3] == ["lj-1000000", "kickdrift over LAMMPS omp 1", "4.4"]
    assert [row[-1] for row in rows] == ["4.50", *["–"] * (len(rows) - 1)]
    page = (DOCS / "roofline.md").read_text(encoding="utf-8")
    assert page.count(predictions.BEGIN) == page.count(predictions.END) == 1
