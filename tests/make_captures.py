"""Writes captures with h5py, an independent writer, into the folder given.

Sample k of every channel is ((k * 7919) mod 65536) - 32768, which every number type holds exactly.
"""
import itertools
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
