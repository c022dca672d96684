import gzip
import hashlib
import http.server
import shutil
import threading
import zipfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl import datasets
from labctl.datasets import store
from labctl.datasets.cards import Archive, Card, DataFile, bundled_directory
from labctl.datasets.images import ImageSet, choose, read_image_set
from labctl.errors import NotWritten

IMAGES = np.arange(6 * 28 * 28).astype(np.uint8).reshape(6, 28, 28)
LABELS = np.array([0, 1, 0, 1, 2, 2], np.uint8)


@pytest.fixture
def no_other_place(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("LABCTL_DATA", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture
def tiny(tmp_path: Path) -> Card:
    """A small idx data set in `tmp_path/source/tiny`, with the card that describes it."""
    folder = tmp_path / "source" / "tiny"
    folder.mkdir(parents=True)
    contents = {
        "images.gz": bytes([0, 0, 8, 3, 0, 0, 0, 6, 0, 0, 0, 28, 0, 0, 0, 28]) + IMAGES.tobytes(),
        "labels.gz": bytes([0, 0, 8, 1, 0, 0, 0, 6]) + LABELS.tobytes(),
    }
    files = []
    for name, content in contents.items():
        packed = gzip.compress(content, mtime=0)
        (folder / name).write_bytes(packed)
        files.append(
            DataFile(
                name=name,
                role="images" if name == "images.gz" else "labels",
                sha256=hashlib.sha256(content).hexdigest(),
                sha256_gz=hashlib.sha256(packed).hexdigest(),
            )
        )
    return Card(
        name="tiny",
        title="Tiny",
        folder="tiny",
        source="http://127.0.0.1:9/",
        licence="none",
        attribution="nobody",
        shape=(6, 28, 28),
        classes=("a", "b", "c"),
        files=tuple(files),
    )


class QuietHandler(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        pass


@pytest.fixture
def served(tiny: Card, tmp_path: Path) -> Iterator[Card]:
    """The tiny set behind a real HTTP server."""
    handler = partial(QuietHandler, directory=str(tmp_path / "source" / "tiny"))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        yield tiny.model_copy(update={"source": f"http://127.0.0.1:{server.server_port}/"})
        server.shutdown()
        thread.join()


def test_every_card_names_source_licence_and_authors() -> None:
    cards = {card.name: card for card in datasets.catalogue()}
    assert set(cards) == {"mnist", "mnist-0-3", "fashion-mnist", "cracks", "vowels", "santa-fe"}
    for card in cards.values():
        assert card.source
        assert card.attribution
        assert card.traps
    assert cards["mnist-0-3"].licence == "CC BY-SA 3.0"
    assert cards["mnist-0-3"].binarisation == "pixel >= 128"
    assert all(file.sha256_gz for name in ("mnist", "fashion-mnist") for file in cards[name].files)


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(datasets.DatasetError, match=r"'mnits'.*fashion-mnist, mnist, mnist-0-3, santa-fe"):
        datasets.load("mnits")


def test_the_bundled_sample_needs_nothing_else(no_other_place: None) -> None:
    sample = datasets.load("mnist-0-3", images=1000, seed=5)
    assert sample.images.shape == (1000, 28, 28)
    assert sample.images.dtype == np.bool_
    assert np.bincount(sample.labels).tolist() == [250] * 4
    assert np.all(np.diff(sample.indices) > 0)
    assert 0.05 < sample.images.mean() < 0.2
    assert all(check.ok for check in datasets.verify("mnist-0-3"))
    assert datasets.path("mnist-0-3") == datasets.fetch("mnist-0-3") == bundled_directory() / "mnist-0-3"


def test_a_seed_chooses_the_images() -> None:
    first, again, other = (datasets.load("mnist-0-3", images=40, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.images, again.images)
    assert first.indices.tolist() != other.indices.tolist()


def test_without_seed_the_first_images_of_each_class_come() -> None:
    few, all_of_them = datasets.load("mnist-0-3", images=8), datasets.load("mnist-0-3")
    assert len(all_of_them) == 4000
    for label in range(4):
        rows = all_of_them.indices[all_of_them.labels == label]
        np.testing.assert_array_equal(few.indices[few.labels == label], rows[:2])


@given(st.data())
def test_a_choice_is_balanced_and_without_repetition(data: st.DataObject) -> None:
    labels = np.array(data.draw(st.lists(st.integers(0, 3), min_size=4, max_size=60)))
    present = sorted(set(labels.tolist()))
    classes = sorted(data.draw(st.sets(st.sampled_from(present), min_size=1)))
    images = data.draw(st.integers(len(classes), 20))
    try:
        chosen = choose(labels, classes=classes, images=images, seed=data.draw(st.none() | st.integers(0, 99)))
    except datasets.DatasetError:
        assert min(np.count_nonzero(labels == label) for label in classes) < -(-images // len(classes))
        return
    counts = [np.count_nonzero(labels[chosen] == label) for label in classes]
    assert sum(counts) == images == len(set(chosen.tolist()))
    assert max(counts) - min(counts) <= 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"classes": [0, 7]}, r"classes \[7\] are not"),
        ({"classes": []}, "no class"),
        ({"images": 3}, "cannot cover 4 classes"),
        ({"images": 5000, "seed": 1}, "at most 4000 images"),
        ({"images": [5, 5]}, "give one for each"),
        ({"images": [5, 5, 5, 0]}, "give one for each"),
    ],
)
def test_an_impossible_choice_says_what_is_possible(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(datasets.DatasetError, match=message):
        datasets.load("mnist-0-3", **arguments)  # type: ignore[arg-type]


def test_classes_may_have_numbers_of_their_own() -> None:
    some = datasets.load("mnist-0-3", classes=[3, 1], images=[5, 7], seed=4)
    assert np.bincount(some.labels).tolist() == [0, 7, 0, 5]
    assert np.all(np.diff(some.indices) > 0)


@pytest.mark.parametrize("name", ["cracks", "vowels"])
def test_what_cannot_be_downloaded_says_how_to_get_it(name: str, no_other_place: None) -> None:
    for ask in (datasets.fetch, datasets.path, datasets.load if name == "cracks" else datasets.load_sequences):
        with pytest.raises(
            datasets.DatasetError, match=r"not found \(looked in .*\): download .* LABCTL_DATA"
        ) as caught:
            ask(name)
        assert "\n" not in str(caught.value)


def test_a_set_of_the_other_kind_is_refused() -> None:
    with pytest.raises(datasets.DatasetError, match="'vowels' holds sequences"):
        datasets.load("vowels")
    with pytest.raises(datasets.DatasetError, match="'mnist' holds images"):
        datasets.load_sequences("mnist")


def test_a_folder_is_found_by_argument_then_variable_then_cache(
    tiny: Card, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_other_place: None
) -> None:
    source, cached = tmp_path / "source", store.cache_directory() / "tiny"
    assert cached.is_relative_to(tmp_path)
    with pytest.raises(datasets.DatasetError, match="labctl data fetch tiny"):
        store.locate(tiny)
    shutil.copytree(source / "tiny", cached)
    assert store.locate(tiny) == cached
    shutil.copytree(source / "tiny", tmp_path / "pointed" / "tiny")
    monkeypatch.setenv("LABCTL_DATA", str(tmp_path / "pointed"))
    assert store.locate(tiny) == tmp_path / "pointed" / "tiny"
    assert store.locate(tiny, source) == store.locate(tiny, source / "tiny") == source / "tiny"


def test_idx_files_become_an_image_set(tiny: Card, tmp_path: Path) -> None:
    read = read_image_set(tiny, tmp_path / "source" / "tiny")
    np.testing.assert_array_equal(read.images, IMAGES)
    np.testing.assert_array_equal(read.labels, LABELS)
    assert "nobody" in read.source
    binary = read.binarised(100)
    np.testing.assert_array_equal(binary.images, IMAGES >= 100)
    assert binary.binarisation == "pixel >= 100"
    assert binary.binarised() is binary
    with pytest.raises(datasets.DatasetError, match="no binarisation"):
        binary.binarised("oztu")


def test_what_was_read_once_is_read_anew_when_its_file_is_another(tiny: Card, tmp_path: Path) -> None:
    folder = tmp_path / "source" / "tiny"
    read_image_set(tiny, folder).images[:] = 0
    np.testing.assert_array_equal(read_image_set(tiny, folder).images, IMAGES)
    (folder / tiny.files[0].name).write_bytes(b"something else")
    with pytest.raises(datasets.DatasetError, match="replace the file"):
        read_image_set(tiny, folder)


def test_loading_what_is_nowhere_tries_the_source(no_other_place: None, monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("HTTPS_PROXY", "https_proxy"):
        monkeypatch.setenv(variable, "http://127.0.0.1:9")
    with pytest.raises(datasets.DatasetError, match=r"'mnist' is not on this machine .* cannot be reached"):
        datasets.load("mnist", classes=[0, 1, 2, 3], images=100, seed=1)


@pytest.mark.parametrize("dtype", [np.bool_, np.uint8])
def test_a_set_of_ones_own_is_an_npz_file(dtype: type, tmp_path: Path) -> None:
    images: np.ndarray = (np.arange(6 * 12).reshape(6, 3, 4) % 2).astype(dtype)
    np.savez(tmp_path / "own.npz", images=images, labels=LABELS)
    read = datasets.load(str(tmp_path / "own.npz"), classes=[0, 2])
    np.testing.assert_array_equal(read.images, images[[0, 2, 4, 5]])
    assert read.labels.tolist() == [0, 0, 2, 2]


@pytest.mark.parametrize(
    ("images", "message"),
    [
        (24, "8 images of class 1 were asked for, the data set has 5: ask for at most 15 images"),
        ([4, 6, 8], "6 images of class 1 were asked for, the data set has 5: ask for at most 5 of it"),
    ],
)
def test_what_is_possible_is_so_for_every_class(images: int | list[int], message: str) -> None:
    labels = np.repeat([0, 1, 2], [7, 5, 9])
    with pytest.raises(datasets.DatasetError, match=message):
        choose(labels, classes=None, images=images, seed=1)
    assert choose(labels, classes=None, images=15, seed=1).size == 15


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"images": IMAGES}, "arrays images and labels"),
        ({"images": IMAGES[0], "labels": LABELS}, "store bool or uint8"),
        ({"images": IMAGES.astype(float), "labels": LABELS}, "store bool or uint8"),
        ({"images": IMAGES, "labels": LABELS[:5]}, "one integer for each image"),
        ({"images": IMAGES, "labels": LABELS / 2}, "one integer for each image"),
    ],
)
def test_an_npz_file_of_something_else_is_refused(arrays: dict[str, np.ndarray], message: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "own.npz", **arrays)  # type: ignore[arg-type]
    with pytest.raises(datasets.DatasetError, match=message):
        datasets.load(str(tmp_path / "own.npz"))


@pytest.mark.parametrize("content", [b"", b"text", b"PK\x03\x04 cut"])
def test_a_file_that_is_no_npz_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "own.npz").write_bytes(content)
    with pytest.raises(datasets.DatasetError, match=r"not an \.npz file"):
        datasets.load(str(tmp_path / "own.npz"))


def test_one_that_is_not_there_is_named_by_its_whole_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(datasets.DatasetError, match=f"^{tmp_path}/own.npz: no such file: repeat the command in the fo"):
        datasets.load("own.npz")


def test_a_single_array_is_no_npz_file(tmp_path: Path) -> None:
    with (tmp_path / "own.npz").open("wb") as file:
        np.save(file, IMAGES)
    with pytest.raises(datasets.DatasetError, match=r"not an \.npz file"):
        datasets.load(str(tmp_path / "own.npz"))


def test_files_compressed_by_another_program_are_accepted(tiny: Card, tmp_path: Path) -> None:
    folder = tmp_path / "source" / "tiny"
    image_file = folder / "images.gz"
    image_file.write_bytes(gzip.compress(gzip.decompress(image_file.read_bytes()), compresslevel=1, mtime=9))
    assert hashlib.sha256(image_file.read_bytes()).hexdigest() != tiny.files[0].sha256_gz
    assert all(check.ok for check in store.check(tiny, folder))


@pytest.mark.parametrize("damage", ["cut", "other content", "not gzip", "flipped byte"])
def test_damage_is_reported_for_the_file_it_struck(tiny: Card, tmp_path: Path, damage: str) -> None:
    folder = tmp_path / "source" / "tiny"
    file = folder / "images.gz"
    content = file.read_bytes()
    middle = len(content) // 2
    file.write_bytes(
        {
            "cut": content[:-20],
            "other content": gzip.compress(b"something else"),
            "not gzip": b"<html>not found</html>",
            "flipped byte": content[:middle] + bytes([content[middle] ^ 0xFF]) + content[middle + 1 :],
        }[damage]
    )
    images, labels = store.check(tiny, folder)
    assert not images.ok
    assert "replace the file" in images.problem
    assert "\n" not in images.problem
    assert labels.ok
    with pytest.raises(datasets.DatasetError, match=r"images\.gz"):
        read_image_set(tiny, folder)


def test_a_download_is_checked_and_kept(served: Card, tmp_path: Path) -> None:
    folder = store.download(served, tmp_path / "cache")
    assert all(check.ok for check in store.check(served, folder))
    assert isinstance(read_image_set(served, folder), ImageSet)
    shutil.rmtree(tmp_path / "source")
    assert store.download(served, tmp_path / "cache") == folder


@pytest.fixture
def packed(served: Card, tmp_path: Path) -> Card:
    """A card whose one file lies in a zip archive at the server."""
    content = b"what is wanted"
    archive = tmp_path / "source" / "tiny" / "much.whl"
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("much/wanted.npy", content)
        file.writestr("much/else.py", "nothing to run")
    where = Archive(name="much.whl", member="much/wanted.npy", sha256=hashlib.sha256(archive.read_bytes()).hexdigest())
    wanted = DataFile(name="wanted.npy", role="series", sha256=hashlib.sha256(content).hexdigest(), archive=where)
    return served.model_copy(update={"files": (wanted,)})


def test_of_an_archive_only_the_file_is_kept(packed: Card, tmp_path: Path) -> None:
    folder = store.download(packed, tmp_path / "cache")
    assert [path.name for path in folder.iterdir()] == ["wanted.npy"]
    assert all(check.ok for check in store.check(packed, folder))
    shutil.rmtree(tmp_path / "source")
    assert store.download(packed, tmp_path / "cache") == folder


@pytest.mark.parametrize("damage", ["content", "member"])
def test_another_archive_is_refused(packed: Card, tmp_path: Path, damage: str) -> None:
    (file,) = packed.files
    assert file.archive is not None
    if damage == "content":
        (tmp_path / "source" / "tiny" / "much.whl").write_bytes(b"tampered")
    else:
        file = file.model_copy(update={"archive": file.archive.model_copy(update={"member": "not there"})})
    with pytest.raises(datasets.DatasetError, match="what was downloaded is not the file on the card"):
        store.download(packed.model_copy(update={"files": (file,)}), tmp_path / "cache")


def test_a_download_of_something_else_is_refused(served: Card, tmp_path: Path) -> None:
    (tmp_path / "source" / "tiny" / "labels.gz").write_bytes(b"tampered")
    with pytest.raises(datasets.DatasetError, match="sha256 differs"):
        store.download(served, tmp_path / "cache")
    assert not (tmp_path / "cache" / "tiny" / "labels.gz").exists()


def test_a_cache_that_cannot_be_made_is_no_fault_of_the_network(tiny: Card, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(NotWritten, match="Not a directory"):
        store.download(tiny, tmp_path / "file")


def test_a_user_without_home_is_told_what_to_set(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr("os.getuid", lambda: 54321)
    with pytest.raises(datasets.DatasetError, match="no home"):
        store.cache_directory()


def test_without_network_the_error_says_how_to_get_the_data(tiny: Card, tmp_path: Path) -> None:
    with pytest.raises(datasets.DatasetError, match="cannot be reached") as caught:
        store.download(tiny, tmp_path / "cache")
    assert "LABCTL_DATA" in str(caught.value)
    assert "\n" not in str(caught.value)
