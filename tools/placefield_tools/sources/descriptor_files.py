"""Files of descriptors, one per frame: NumPy's ``.npy`` and ``.npz``, and hloc's ``.h5``.

A ``.npy`` has an array (N, D), as VPR-methods-evaluation writes it. A ``.npz`` has one array, or
one that is named ``descriptors``. In an ``.h5``, each image has a group with the dataset
``global_descriptor``, (D,); ``FILE.h5/GROUP`` are the images in one group.
"""

import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.errors import ConfigError, SourceError
from placefield_tools.common.natural_sort import in_natural_order

NUMPY_SUFFIXES = (".npy", ".npz")
_HDF5_SUFFIXES = (".h5", ".hdf5")
_PICKLES = (".pickle", ".pkl", ".pt", ".pth", ".torch")
_IN_NPZ = "descriptors"
_IN_HDF5 = "global_descriptor"
_DTYPES = (np.float16, np.float32, np.float64)


class DescriptorArray(NamedTuple):
    """The descriptors of N frames.

    Attributes:
        names: N names of the frames, used in messages.
        vectors: (N, D) float16, float32 or float64; those of a ``.npy`` are memory-mapped.
    """

    names: list[str]
    vectors: NDArray[np.floating]


def is_descriptor_file(path: Path) -> bool:
    """Return whether a path names a file of descriptors, or a group in one."""
    if path.suffix.lower() in (*NUMPY_SUFFIXES, *_PICKLES):
        return path.is_file()
    return _hdf5_file(path) is not None


def read_descriptors(path: Path, *, one: bool = False) -> DescriptorArray:
    """Read a file of descriptors.

    Args:
        path: the file, or a group in an ``.h5``.
        one: whether an array (D,), the descriptor of one frame, is accepted, too.

    Raises:
        SourceError: the file is damaged, has no such array or group, or the array is empty, of
            another shape or of another dtype.
        ConfigError: h5py is not installed.
    """
    if (file := _hdf5_file(path)) is not None:
        return _read_hdf5(path, file)
    vectors = _read_numpy(path)
    if one and vectors.ndim == 1:
        vectors = vectors[None]
    _check(path, vectors)
    return DescriptorArray([f"{path.name}#{number}" for number in range(len(vectors))], vectors)


def _read_numpy(path: Path) -> NDArray[Any]:
    if path.suffix.lower() in _PICKLES:
        raise SourceError(
            f"{path}: pickles are not read, because they can run code; "
            "save the array with numpy.save"
        )
    try:
        if path.suffix.lower() == ".npy":
            mapped: NDArray[Any] = np.load(path, mmap_mode="r", allow_pickle=False)
            return mapped
        with np.load(path, allow_pickle=False) as arrays:
            name = _IN_NPZ if _IN_NPZ in arrays.files or len(arrays.files) != 1 else arrays.files[0]
            if name not in arrays.files:
                held = ", ".join(arrays.files) or "no array"
                raise SourceError(f"{path}: holds {held}; name the array of descriptors {_IN_NPZ}")
            held_array: NDArray[Any] = arrays[name]
            return held_array
    except (ValueError, EOFError, zipfile.BadZipFile) as error:
        raise SourceError(f"{path}: no array of numbers, or cut off ({error})") from None


def _read_hdf5(path: Path, file: Path) -> DescriptorArray:
    try:
        import h5py
    except ModuleNotFoundError:
        raise ConfigError(f"{file} needs h5py: pip install 'placefield[hloc]'") from None
    group = path.relative_to(file).as_posix()
    try:
        with h5py.File(file, "r") as opened:
            if group != "." and not isinstance(opened.get(group), h5py.Group):
                raise SourceError(f"{file}: has no group {group!r}; it has {', '.join(opened)}")
            images = _images_in(opened if group == "." else opened[group], h5py.Dataset)
            if not images:
                raise SourceError(f"{path}: holds no {_IN_HDF5}, which hloc writes for each image")
            names = in_natural_order(images)
            _check_alike(path, [(name, images[name].shape[-1:]) for name in names])
            vectors = np.stack([images[name][()] for name in names])
    except (OSError, RuntimeError, ValueError) as error:
        raise SourceError(f"{file}: no HDF5 file, or damaged ({error})") from None
    _check(path, vectors)
    return DescriptorArray(names, vectors)


def _images_in(group: Any, dataset: type) -> dict[str, Any]:
    """Return the datasets of the descriptors in a group by the names of their images."""
    found = {}

    def visit(name: str, item: Any) -> None:
        image, _, last = name.rpartition("/")
        if last == _IN_HDF5 and isinstance(item, dataset):
            found[image] = item

    group.visititems(visit)  # does not follow links to other files
    return found


def _hdf5_file(path: Path) -> Path | None:
    """Return the HDF5 file that a path names, or leads into."""
    for part in (path, *path.parents):
        if part.suffix.lower() in _HDF5_SUFFIXES and part.is_file():
            return part
    return None


def _check(path: Path, vectors: NDArray[Any]) -> None:
    if vectors.dtype.newbyteorder("=") not in _DTYPES:
        raise SourceError(f"{path}: is of {vectors.dtype}; give float16, float32 or float64")
    if vectors.ndim != 2:
        raise SourceError(f"{path}: has shape {vectors.shape}; give (N, D), a row for each frame")
    if not len(vectors):
        raise SourceError(f"{path}: holds no descriptor")
    if vectors.shape[1] < 2:
        raise SourceError(f"{path}: descriptors of {vectors.shape[1]} dimensions; give more")


def _check_alike(path: Path, shapes: list[tuple[str, tuple[int, ...]]]) -> None:
    first, expected = shapes[0]
    for name, shape in shapes:
        if shape != expected:
            raise SourceError(
                f"{path}: the descriptor of {name} has {shape} numbers, that of {first} {expected}"
            )
