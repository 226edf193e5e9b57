"""Writes captures with h5py, an independent writer, into the folder given.

Sample k of every channel is ((k * 7919) mod 65536) - 32768, which every number type holds exactly.
"""
import itertools
import shutil
import sys

import h5py
import numpy as np

N = 20_000
k = np.arange(N, dtype=np.int64)
counts = (k * 7919) % 65536 - 32768

storages = {
    "contiguous": {},
    "chunked": dict(chunks=(3000,)),
    "gzip": dict(chunks=(3000,), compression="gzip"),
    "gzip_shuffle": dict(chunks=(4096,), compression="gzip", shuffle=True),
    "fletcher32": dict(chunks=(4096,), fletcher32=True),
    "lzf": dict(chunks=(4096,), compression="lzf", shuffle=True),
    "resizable": dict(chunks=(1000,), maxshape=(None,), compression="gzip"),
    "one_chunk": dict(chunks=(N,), compression="gzip"),
}


def channel(file, name="x", n=N, **options):
    data = file.create_dataset(f"channels/{name}", data=counts[:n].astype("f4"), **options)
    data.attrs["sample_rate_hz"] = 2000.0
    return data


# Small files, mostly headers, to be damaged.
for libver in ["earliest", "v110", "latest"]:
    with h5py.File(f"{sys.argv[1]}/small_{libver}.h5", "w", libver=(libver, "latest")) as file:
        file.attrs["format"] = "rotorwatch-capture"
        file.attrs["version"] = 1
        for name in "xy":
            data = channel(file, name, n=600, compression="gzip", chunks=(100,))
            data.attrs["unit"] = "g"
        file["segments/start_sample"] = np.array([0, 70, 120])
        file["segments/time_s"] = np.array([0.0, 10.0, 20.0])

# A recorder killed while recording: what was flushed, with the in-use flags still set.
with h5py.File(f"{sys.argv[1]}/recording", "w", libver="latest") as file:
    data = channel(file, chunks=(4096,), maxshape=(None,), compression="gzip")
    file.swmr_mode = True
    data.resize((2 * N,))
    data[N:] = counts
    data.flush()
    shutil.copy(f"{sys.argv[1]}/recording", f"{sys.argv[1]}/killed_recording.h5")

# What must be refused, by the word the refusal must contain.
with h5py.File(f"{sys.argv[1]}/refused_zfp.h5", "w") as file:
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk((1000,))
    plist.set_filter(32013, h5py.h5z.FLAG_OPTIONAL, ())
    group = file.create_group("channels")
    h5py.h5d.create(group.id, b"x", h5py.h5t.NATIVE_FLOAT, h5py.h5s.create_simple((N,)), plist)
    group["x"].attrs["sample_rate_hz"] = 2000.0
with h5py.File(f"{sys.argv[1]}/refused_link.h5", "w") as file:
    file["channels/x"] = h5py.ExternalLink("killed_recording.h5", "/channels/x")
with h5py.File(f"{sys.argv[1]}/refused_external.h5", "w") as file:
    channel(file, external=[(f"{sys.argv[1]}/raw", 0, h5py.h5f.UNLIMITED)])
with h5py.File(f"{sys.argv[1]}/refused_virtual.h5", "w", libver="latest") as file:
    layout = h5py.VirtualLayout((N,), "f4")
    layout[:] = h5py.VirtualSource("killed_recording.h5", "/channels/x", (2 * N,), "f4")[:N]
    file.create_virtual_dataset("channels/x", layout).attrs["sample_rate_hz"] = 2000.0
with h5py.File(f"{sys.argv[1]}/refused_dimension.h5", "w") as file:
    file["channels/x"] = counts.reshape(2, -1).astype("f4")
with h5py.File(f"{sys.argv[1]}/refused_compound.h5", "w") as file:
    file["channels/x"] = np.zeros(9, dtype=[("compound", "f4"), ("b", "f4")])

for libver, (storage, options), order in itertools.product(
    ["earliest", "v110", "latest"], storages.items(), "<>"
):
    name = f"{sys.argv[1]}/{libver}_{storage}_{'le' if order == '<' else 'be'}.h5"
    userblock = {"userblock_size": 1024} if storage == "chunked" else {}
    tracked = {"track_order": True} if storage == "gzip" else {}
    with h5py.File(name, "w", libver=(libver, "latest"), **userblock, **tracked) as file:
        fixed = storage in ("contiguous", "gzip")  # else variable length
        text = (lambda s: np.bytes_(s)) if fixed else (lambda s: s)
        file.attrs["format"] = text("rotorwatch-capture")
        file.attrs["start_time"] = text("2026-03-01T12:00:00Z")
        file.attrs["version"] = np.dtype(order + "i4").type(1) if fixed else 1
        file.attrs.create("shaft_speed_hz", 29.95, dtype=order + "f8")
        file.attrs["machine"] = text("[machine]\n" * 500)
        if storage == "lzf":
            for i in range(30):  # enough for dense attribute storage
                file.attrs[f"note_{i}"] = i
        for kind in ("f4", "f8", "i2", "i4"):
            data = file.create_dataset(
                f"channels/{kind}", data=counts.astype(order + kind), **options
            )
            data.attrs["sample_rate_hz"] = np.float32(2000) if kind == "f4" else 2000
            data.attrs["unit"] = text("m/s^2")
            data.attrs["sensor"] = text("accelerometer")
            if kind == "i4":
                data.attrs["scale"] = np.float32(0.5)
                data.attrs["offset"] = np.array([3.0])
        if storage in ("chunked", "gzip_shuffle"):
            file["segments/start_sample"] = np.array([0, 7000, 12000], dtype=order + "i8")
            file["segments/time_s"] = np.array([0.0, 10.0, 20.0], dtype=order + "f8")
        if storage == "gzip":
            file.create_group("truth").attrs["label"] = "never read"
    print(name)
