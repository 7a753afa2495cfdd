"""A kill may fall between two writes to a run's file, or inside a write: all flushed data can still be read."""

from __future__ import annotations

from importlib.util import find_spec

import h5py
import numpy as np
import pytest

from kickdrift.trajectory.file import storage
from kickdrift.trajectory.layout.options import FileOptions
from kickdrift_validation import file_prefixes
from kickdrift_validation.file_prefixes import (
    Recorder,
    check_h5py,
    check_kickdrift,
    check_mdanalysis,
    failures,
    resumed,
)


@pytest.fixture(autouse=True)
def small():
    with file_prefixes.small_chunks():
        yield


@pytest.fixture
def recorder(tmp_path):
    return Recorder(tmp_path / "run.h5md")


def test_every_beginning_of_the_writes_is_a_whole_file(recorder, tmp_path):
    """Each frame takes ten chunks. The index of the chunks, 64 entries in a node, splits at the seventh frame."""
    recorder.run(range(8))
    recorder.run(range(8, 10))
    places, wrong = failures(recorder.writes, tmp_path / "copy.h5md", {check_h5py: 1, check_kickdrift: 5})
    assert not wrong
    assert places > 250
    with h5py.File(recorder.path) as file:
        assert file["particles/trajectory/position/value"].id.get_num_chunks() == 100


@pytest.mark.filterwarnings("ignore:there is no reference attributes:UserWarning")
def test_mdanalysis_finds_no_frame_that_is_not_whole(recorder, tmp_path):
    pytest.importorskip("MDAnalysis")
    recorder.run(range(3), FileOptions(write=("forces", "images")))
    places, wrong = failures(recorder.writes, tmp_path / "copy.h5md", {check_mdanalysis: 2})
    assert not wrong
    assert places > 50


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:there is no reference attributes:UserWarning")
def test_what_a_kill_leaves_is_continued(recorder, tmp_path):
    """Cut every write of the last flush and of the close. A second kill may also cut the repair."""
    checks = {check_h5py: 1, check_kickdrift: 10}
    if find_spec("MDAnalysis"):
        checks[check_mdanalysis] = 4
    recorder.run(range(8))
    last = len(recorder.writes) - 1
    for at in range(last - 24, last, 6):
        again = resumed(recorder.writes, at, tmp_path / "again.h5md", 2)
        places, wrong = failures(again.writes, tmp_path / "copy.h5md", checks)
        assert not wrong
        assert places > 30


def test_hdf5s_own_order_would_lose_frames(recorder, tmp_path):
    """Shows that the order of writes matters, and that this test notices."""
    with file_prefixes.hdf5s_own_order():
        recorder.run(range(8))
    _, wrong = failures(recorder.writes, tmp_path / "copy.h5md", {check_h5py: 1})
    assert wrong


def test_index_nodes_lie_in_one_page(recorder):
    """A kill could cut a node on two pages; the system writes a page as a whole."""
    recorder.run(range(8))
    data = recorder.path.read_bytes()
    places = [k for k in range(len(data)) if data.startswith(b"TREE\x01", k)]
    assert len(places) > 20
    assert not [place for place in places if place % storage.PAGE]


@pytest.mark.parametrize("compress", [False, True])
def test_what_is_counted_in_one_write_is_in_the_first_page(recorder, compress):
    recorder.run(range(1), FileOptions(compress=compress))
    with h5py.File(recorder.path) as file:
        group = file["particles/trajectory/position"]
        assert file["kickdrift/committed"].id.get_offset() < storage.PAGE - 24
        assert all(h5py.h5o.get_info(group[name].id).addr < storage.PAGE - 512 for name in ("step", "value"))


def test_a_paged_file_is_a_file(tmp_path):
    """Reads see all writes, the disk only committed ones, as in a plain buffer."""
    path = tmp_path / "x"
    rng = np.random.default_rng(1)
    truth = bytearray(rng.bytes(20_000))

    def ends_there(put):
        """End of the file in a superblock."""
        truth[40:48] = len(truth).to_bytes(8, "little")
        put(bytes(truth[40:48]))

    ends_there(lambda end: path.write_bytes(truth))
    file = storage.PagedFile(path)
    try:
        for _ in range(200):
            offset, size = int(rng.integers(48, 30_000)), int(rng.integers(1, 9000))
            data = rng.bytes(size)
            truth.extend(bytes(max(0, offset + size - len(truth))))
            truth[offset : offset + size] = data
            file.seek(offset)
            file.write(data)
            begin, length = int(rng.integers(48, 20_000)), int(rng.integers(1, 9000))
            file.seek(begin)
            assert file.read(length)[: len(truth) - begin] == truth[begin : begin + length]
        file.seek(40)
        ends_there(file.write)
        assert path.stat().st_size == 20_000
        file.commit()
        assert path.read_bytes() == truth
        file.truncate(10_000)
        del truth[10_000:]
        file.seek(40)
        ends_there(file.write)
        assert file.seek(0, 2) == 10_000
        assert path.stat().st_size > 30_000
        file.commit()
        assert path.read_bytes() == truth
    finally:
        file.close()


def test_a_commit_that_was_cut_short_is_finished_by_whoever_writes_next(recorder, tmp_path):
    """This holds once the journal is written; before that, the file is unchanged."""
    recorder.run(range(8))
    copy, ends = tmp_path / "copy.h5md", set()
    last = len(recorder.writes) - 1
    begin = max(k for k, (write, _) in enumerate(recorder.writes) if k < last - 10 and write[0] == "size")
    end = min(k for k, (write, _) in enumerate(recorder.writes) if k > begin and write[0] == "size")
    for index, _ in file_prefixes.replay(recorder.writes, copy):
        if index < begin or index > end:
            continue
        killed = copy.read_bytes()
        storage.PagedFile(copy).close()
        ends.add(copy.read_bytes()[: int.from_bytes(copy.read_bytes()[40:48], "little")])
        copy.write_bytes(killed)
    assert len(ends) == 2, "all of it, or nothing"
