"""Checks with h5py and zlib what this program wrote into the folder given; prints each file."""
import glob
import struct
import sys
import zlib

import h5py
import numpy as np

START_NS = 1_772_366_400_000_000_000


def values(kind, n):
    counts = (np.arange(n, dtype=np.int64) * 7919) % 65536 - 32768
    if kind == "f8":
        return counts * 1e-3
    return (counts * 30_000 if kind == "i4" else counts).astype(kind)


def samples_agree(file):
    """Every block of every channel has the CRC-32 that /checksums states."""
    assert list(file["channels"]) == list(file["checksums"]) == ["f4", "f8", "i2", "i4"]
    for name, data in file["channels"].items():
        assert data.dtype == "<" + name, data.dtype
        raw, sums = data[:], file["checksums"][name]
        assert np.array_equal(raw, values(name, len(raw)))
        block = int(sums.attrs["block_samples"])
        assert sums.dtype == "<u4" and sums.attrs["samples"] == len(raw)
        found = [zlib.crc32(raw[at : at + block].tobytes()) for at in range(0, len(raw), block)]
        assert list(sums) == found


def statement(file):
    """The CRC-32 of what the file states about itself, as docs/hdf5.md defines it."""
    text = b""

    def put(*parts):
        nonlocal text
        for part in parts:
            text += b"%d:%s," % (len(part.encode()), part.encode())

    def number(value):
        return struct.pack(">d", value).hex()

    put("/", "format", file.attrs["format"])
    put("/", "start_time", str(START_NS))
    put("/", "machine", file.attrs["machine"])
    put("/", "shaft_speed_hz", number(file.attrs["shaft_speed_hz"]))
    types = {"f4": "float32", "f8": "float64", "i2": "int16", "i4": "int32"}
    for name, data in sorted(file["channels"].items()):
        place = f"/channels/{name}"
        put(place, "type", types[name])
        put(place, "sample_rate_hz", number(data.attrs["sample_rate_hz"]))
        put(place, "unit", data.attrs["unit"])
        put(place, "sensor", data.attrs["sensor"])
        put(place, "scale", number(data.attrs.get("scale", 1.0)))
        put(place, "offset", number(data.attrs.get("offset", 0.0)))
    segments = file.get("segments")
    starts = segments["start_sample"][:] if segments else []
    put("/segments", "count", str(len(starts)))
    for at, start in enumerate(starts):
        put("/segments", "start_sample", str(start))
        put("/segments", "time_s", number(segments["time_s"][at]))
    return zlib.crc32(text)


paths = glob.glob(f"{sys.argv[1]}/*.h5")
for path in paths:
    with h5py.File(path) as file:
        assert file.attrs["format"] == "rotorwatch-capture" and file.attrs["version"] == 1
        assert file.attrs["machine"] == '[machine]\nid = "rig-1"\n'
        assert file.attrs["shaft_speed_hz"] == 10.0
        assert file.attrs["start_time"] == "2026-03-01T12:00:00Z", file.attrs["start_time"]
        for name, data in file["channels"].items():
            assert data.attrs["unit"] == "g" and data.attrs["sensor"] == "accelerometer"
            assert data.attrs["sample_rate_hz"] == (25_600.0 if name[0] == "f" else 2560.0)
            assert name[0] == "f" or (data.attrs["scale"], data.attrs["offset"]) == (1e-3, -0.5)
        if "segments" in file:
            n = len(file["channels/f4"])
            assert list(file["segments/start_sample"]) == [0, n // 30 * 10]
            assert list(file["segments/time_s"]) == [0.0, 60.5]
        samples_agree(file)
        assert statement(file) == file.attrs["checksum"], path
    print(path)
