"""Writes captures with h5py, an independent writer, into the folder given.

Sample k of every channel is ((k * 7919) mod 65536) - 32768, which every number type holds exactly.
Prints a line a channel, as h5py reads it back: path, channel, samples, CRC-32 of the raw
little-endian bytes, whether the file has segments; and for what must be refused: path, the word the
refusal must contain.
"""
import itertools
import shutil
import sys
import zlib

import h5py
import hdf5plugin
import numpy as np

N = 20_000
k = np.arange(N, dtype=np.int64)
counts = (k * 7919) % 65536 - 32768
folder = sys.argv[1]


def state(path):
    """Prints the content of a capture, read with h5py."""
    with h5py.File(path) as file:
        for name, data in file["channels"].items():
            raw = data[:].astype(data.dtype.newbyteorder("<")).tobytes()
            segmented = "segmented" if "segments" in file else "whole"
            print(path, name, len(data), zlib.crc32(raw), segmented, sep="\t")


def channel(file, name="x", n=N, **options):
    data = file.create_dataset(f"channels/{name}", data=counts[:n].astype("f4"), **options)
    data.attrs["sample_rate_hz"] = 2000.0
    return data


def fixed_text(text):
    return np.bytes_(text)


def variable_text(text):
    return text


def capture(path, kinds, order, text, libver, options, userblock=0, track_order=False, segments=False, notes=0, stated=True):
    """Writes a capture with a channel of each kind, and states it."""
    options_file = {"userblock_size": userblock} if userblock else {}
    with h5py.File(path, "w", libver=(libver, "latest"), track_order=track_order, **options_file) as file:
        file.attrs["format"] = text("rotorwatch-capture")
        file.attrs["start_time"] = text("2026-03-01T12:00:00Z")
        file.attrs["version"] = np.dtype(order + "i4").type(1) if text is fixed_text else 1
        file.attrs.create("shaft_speed_hz", 29.95, dtype=order + "f8")
        file.attrs["machine"] = text("[machine]\n" * 500)
        for i in range(notes):  # enough of them need dense attribute storage
            file.attrs[f"note_{i}"] = i
        for kind in kinds:
            data = file.create_dataset(f"channels/{kind}", data=counts.astype(order + kind), **options)
            data.attrs["sample_rate_hz"] = np.float32(2000) if kind == "f4" else 2000
            data.attrs["unit"] = text("m/s^2")
            data.attrs["sensor"] = text("accelerometer")
            if kind == "i4":
                data.attrs["scale"] = np.float32(0.5)
                data.attrs["offset"] = np.array([3.0])
        if segments:
            file["segments/start_sample"] = np.array([0, 7000, 12000], dtype=order + "i8")
            file["segments/time_s"] = np.array([0.0, 10.0, 20.0], dtype=order + "f8")
        if track_order:
            file.create_group("truth").attrs["label"] = "never read"
    if stated:
        state(path)


KINDS = ("f4", "f8", "i2", "i4")
STORAGES = {
    "contiguous": {},
    "chunked": dict(chunks=(3000,)),
    "gzip": dict(chunks=(3000,), compression="gzip"),
    "gzip_shuffle": dict(chunks=(4096,), compression="gzip", shuffle=True),
    "fletcher32": dict(chunks=(4096,), fletcher32=True),
    "lzf": dict(chunks=(4096,), compression="lzf", shuffle=True),
    "resizable": dict(chunks=(1000,), maxshape=(None,), compression="gzip"),
    "one_chunk": dict(chunks=(N,), compression="gzip"),
}
LIBVERS = ("earliest", "v108", "v110", "v112", "v114", "latest")

for libver, (storage, options), order in itertools.product(LIBVERS, STORAGES.items(), "<>"):
    capture(
        f"{folder}/{libver}_{storage}_{'le' if order == '<' else 'be'}.h5",
        KINDS,
        order,
        fixed_text if storage in ("contiguous", "gzip") else variable_text,
        libver,
        options,
        userblock=1024 if storage == "chunked" else 0,
        track_order=storage == "gzip",
        segments=storage in ("chunked", "gzip_shuffle"),
        notes=30 if storage == "lzf" else 0,
    )

# Filters, each of those this program claims to read.
BLOSC = ("blosclz", "lz4", "lz4hc", "zlib", "zstd")
FILTERS = {
    "szip_nn": dict(compression="szip", compression_opts=("nn", 16)),
    "szip_ec": dict(compression="szip", compression_opts=("ec", 32)),
    "scaleoffset": dict(scaleoffset=0),
    "everything": dict(compression="gzip", shuffle=True, fletcher32=True),
    "zstd": hdf5plugin.Zstd(clevel=3),
    "zstd_shuffle": dict(shuffle=True, **hdf5plugin.Zstd(clevel=19)),
    "lz4": hdf5plugin.LZ4(),
    "lz4_blocks": hdf5plugin.LZ4(nbytes=1024),
    "bzip2": hdf5plugin.BZip2(),
    "bitshuffle": hdf5plugin.Bitshuffle(cname="none"),
    "bitshuffle_lz4": hdf5plugin.Bitshuffle(cname="lz4"),
    "bitshuffle_zstd": hdf5plugin.Bitshuffle(cname="zstd"),
    "bitshuffle_blocks": hdf5plugin.Bitshuffle(nelems=64, cname="lz4"),
    **{
        f"blosc_{name}_{how}": hdf5plugin.Blosc(cname=name, clevel=5, shuffle=how)
        for name, how in itertools.product(BLOSC, (0, 1, 2))
    },
}
# What the library behind the reader lacks, or does wrong: chunks of big-endian numbers through
# scaleoffset that need all bits.
LACKING = {
    ("bitshuffle_zstd", "<"): "bitshuffle with zstd inside",
    ("bitshuffle_zstd", ">"): "bitshuffle with zstd inside",
    ("scaleoffset", ">"): "scaleoffset of big-endian numbers",
}
for (name, options), order in itertools.product(FILTERS.items(), "<>"):
    path = f"{folder}/filter_{name}_{'le' if order == '<' else 'be'}.h5"
    word = LACKING.get((name, order))
    capture(path, KINDS, order, variable_text, "earliest", dict(chunks=(4096,), **options), stated=not word)
    if word:
        print(path, word, sep="\t")


def by_filter(path, number, flags=h5py.h5z.FLAG_MANDATORY, values=()):
    """A capture whose chunks go through the filter of that number, if h5py has no name for it."""
    with h5py.File(path, "w") as file:
        plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plist.set_chunk((1000,))
        plist.set_filter(number, flags, values)
        group = file.create_group("channels")
        space = h5py.h5s.create_simple((N,))
        data = h5py.h5d.create(group.id, b"x", h5py.h5t.NATIVE_FLOAT, space, plist)
        data.write(h5py.h5s.ALL, h5py.h5s.ALL, counts.astype("f4"))
        group["x"].attrs["sample_rate_hz"] = 2000.0


by_filter(f"{folder}/filter_nbit_le.h5", h5py.h5z.FILTER_NBIT)
state(f"{folder}/filter_nbit_le.h5")

# Ways to store that have no filter: inside the header, chunks partly never written, MATLAB's v7.3
# header before the superblock, texts of every kind.
with h5py.File(f"{folder}/compact.h5", "w") as file:
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_layout(h5py.h5d.COMPACT)
    group = file.create_group("channels")
    space = h5py.h5s.create_simple((10_000,))
    data = h5py.h5d.create(group.id, b"x", h5py.h5t.STD_I16BE, space, plist)
    data.write(h5py.h5s.ALL, h5py.h5s.ALL, counts[:10_000].astype("i2"))
    group["x"].attrs["sample_rate_hz"] = 2000.0
with h5py.File(f"{folder}/unwritten.h5", "w") as file:
    data = file.create_dataset("channels/x", (N,), "i4", chunks=(1000,), fillvalue=-7, compression="gzip")
    data.attrs["sample_rate_hz"] = 2000.0
    data[2500:4500] = counts[2500:4500]
with h5py.File(f"{folder}/matlab.h5", "w", userblock_size=512) as file:
    channel(file, chunks=(4096,), compression="gzip").attrs["MATLAB_class"] = np.bytes_("single")
with open(f"{folder}/matlab.h5", "r+b") as file:
    file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
with h5py.File(f"{folder}/texts.h5", "w") as file:
    file.attrs.create("format", "rotorwatch-capture", dtype=h5py.string_dtype("utf-8", 40))
    file.attrs.create("start_time", "2026-03-01T12:00:00Z", dtype=h5py.string_dtype("ascii"))
    space_padded = h5py.h5t.C_S1.copy()
    space_padded.set_size(8)
    space_padded.set_strpad(h5py.h5t.STR_SPACEPAD)
    data = channel(file)
    unit = h5py.h5a.create(data.id, b"unit", space_padded, h5py.h5s.create(h5py.h5s.SCALAR))
    unit.write(np.array(b"m/s^2   ", dtype="S8"), mtype=space_padded)
for name in ("compact", "unwritten", "matlab", "texts"):
    state(f"{folder}/{name}.h5")

# Small files, mostly headers, to be damaged.
for libver in ["earliest", "v110", "latest"]:
    with h5py.File(f"{folder}/small_{libver}.h5", "w", libver=(libver, "latest")) as file:
        file.attrs["format"] = "rotorwatch-capture"
        file.attrs["version"] = 1
        for name in "xy":
            data = channel(file, name, n=600, compression="gzip", chunks=(100,))
            data.attrs["unit"] = "g"
        file["segments/start_sample"] = np.array([0, 70, 120])
        file["segments/time_s"] = np.array([0.0, 10.0, 20.0])

# A recorder killed while recording: what was flushed, with the in-use flags still set.
with h5py.File(f"{folder}/recording", "w", libver="latest") as file:
    data = channel(file, chunks=(4096,), maxshape=(None,), compression="gzip")
    file.swmr_mode = True
    data.resize((2 * N,))
    data[N:] = counts
    data.flush()
    shutil.copy(f"{folder}/recording", f"{folder}/killed_recording.h5")


def refused(name, word=None):
    print(f"{folder}/refused_{name}.h5", word or name, sep="\t")


# What must be refused.
for name, options in {
    "blosc2": hdf5plugin.Blosc2(),
    "zfp": hdf5plugin.Zfp(reversible=True),
    "sz": hdf5plugin.SZ(absolute=0.5),
    "sz3": hdf5plugin.SZ3(absolute=0.5),
}.items():
    with h5py.File(f"{folder}/refused_{name}.h5", "w") as file:
        channel(file, chunks=(1000,), **options)
    refused(name)
by_filter(f"{folder}/refused_unknown.h5", 511, h5py.h5z.FLAG_OPTIONAL)
refused("unknown", "filter number 511")
with h5py.File(f"{folder}/refused_link.h5", "w") as file:
    file["channels/x"] = h5py.ExternalLink("killed_recording.h5", "/channels/x")
refused("link")
with h5py.File(f"{folder}/refused_external.h5", "w") as file:
    channel(file, external=[(f"{folder}/raw", 0, h5py.h5f.UNLIMITED)])
refused("external")
with h5py.File(f"{folder}/refused_virtual.h5", "w", libver="latest") as file:
    layout = h5py.VirtualLayout((N,), "f4")
    layout[:] = h5py.VirtualSource("killed_recording.h5", "/channels/x", (2 * N,), "f4")[:N]
    file.create_virtual_dataset("channels/x", layout).attrs["sample_rate_hz"] = 2000.0
refused("virtual")
with h5py.File(f"{folder}/refused_dimension.h5", "w") as file:
    file["channels/x"] = counts.reshape(2, -1).astype("f4")
refused("dimension")
with h5py.File(f"{folder}/refused_compound.h5", "w") as file:
    file["channels/x"] = np.zeros(9, dtype=[("compound", "f4"), ("b", "f4")])
refused("compound")
