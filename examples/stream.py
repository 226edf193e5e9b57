#!/usr/bin/env python3
"""Streams a capture (HDF5) into a running rotorwatch and prints its diagnosis: the protocol of docs/wire.md.

    python3 examples/stream.py run-7.h5 127.0.0.1 8081 rig-1 [http://127.0.0.1:8080]
"""
import collections, json, socket, struct, sys, time, urllib.request
import h5py, numpy as np

TABLE = [0] * 256  # CRC-32C, Castagnoli; a library such as `crc32c` is faster
for n in range(256):
    c = n
    for _ in range(8):
        c = c >> 1 ^ 0x82F63B78 if c & 1 else c >> 1
    TABLE[n] = c

def crc32c(data):
    c = 0xFFFFFFFF
    for byte in data:
        c = c >> 8 ^ TABLE[(c ^ byte) & 255]
    return c ^ 0xFFFFFFFF

def frame(kind, payload=b""):
    head = b"RW" + bytes([1, kind]) + struct.pack("<I", len(payload))
    return head + struct.pack("<I", crc32c(head + payload)) + payload

def text(words):
    return struct.pack("<H", len(words.encode())) + words.encode()

def receive(sock):  # kind and payload of the next frame
    def exactly(n):
        data = b""
        while len(data) < n:
            more = sock.recv(n - len(data))
            if not more:
                raise ConnectionError("the daemon has closed the connection")
            data += more
        return data
    head = exactly(12)
    kind, payload = head[3], exactly(struct.unpack("<I", head[4:8])[0])
    if kind == 5:
        raise SystemExit(f"refused, code {struct.unpack('<H', payload[:2])[0]}: {payload[4:].decode()}")
    return kind, payload

def stream(path, host, port, machine):
    with h5py.File(path) as file:
        channels = [(name, data[()].astype("<f4"), dict(data.attrs)) for name, data in file["channels"].items()]
        speed = float(file.attrs.get("shaft_speed_hz", np.nan))
    epoch = time.time_ns()
    hello = text(machine) + text("") + struct.pack("<QddH", epoch, speed, np.nan, len(channels))
    for name, _, about in channels:
        hello += text(name) + struct.pack("<dB", about["sample_rate_hz"], 3)  # 3: f32
        hello += struct.pack("<5d", about.get("scale", 1), about.get("offset", 0), 0, np.nan, np.nan)
        hello += text(about.get("unit", ""))
    blocks = []  # a tenth of a second each, in the order of time
    for place, (_, samples, about) in enumerate(channels):
        rate = float(about["sample_rate_hz"])
        step = max(1, int(rate / 10))
        for k, first in enumerate(range(0, len(samples), step)):
            blocks.append((first / rate, place, k, first, samples[first:first + step]))
    blocks.sort(key=lambda block: block[0])
    start = epoch - int(1e9 * max(len(s) / a["sample_rate_hz"] for _, s, a in channels))
    waiting = collections.deque(
        (place, k, frame(3, struct.pack("<HBBIQQq", place, 3, 0, len(x), k, first, start + int(1e9 * at)) + x.tobytes()))
        for at, place, k, first, x in blocks)
    sent = collections.deque()  # not settled yet
    while waiting or sent:
        try:
            with socket.create_connection((host, port)) as sock:
                sock.sendall(frame(1, hello))
                payload = receive(sock)[1]  # welcome: credit, and where each channel goes on
                credit, wanted = struct.unpack("<I", payload[:4])[0], list(struct.iter_unpack("<QQ", payload[6:]))
                waiting.extendleft(reversed(sent))
                waiting = collections.deque(block for block in waiting if block[1] >= wanted[block[0]][0])
                sent.clear()
                while waiting or sent:
                    way = sum(len(block[2]) for block in sent)
                    while waiting and credit and (not way or way + len(waiting[0][2]) <= credit):
                        sent.append(waiting.popleft())
                        way += len(sent[-1][2])
                        sock.sendall(sent[-1][2])
                    kind, payload = receive(sock)  # an ack comes within a tenth of a second
                    credit = struct.unpack("<I", payload[:4])[0]
                    for place, wanted in struct.iter_unpack("<HQ", payload[6:]):
                        sent = collections.deque(block for block in sent if block[0] != place or block[1] >= wanted)
                sock.sendall(frame(6, b"\1"))  # bye: the stream is complete
                while sock.recv(4096):
                    pass
        except OSError as broken:
            print(f"{broken}, trying again", file=sys.stderr)
            time.sleep(1)

if __name__ == "__main__":
    path, host, port, machine = sys.argv[1:5]
    stream(path, host, int(port), machine)
    base = sys.argv[5] if len(sys.argv) > 5 else "http://127.0.0.1:8080"
    time.sleep(2)  # the last window is being judged
    with urllib.request.urlopen(f"{base}/api/v1/machines/{machine}/diagnosis") as answer:
        for part in json.load(answer)["components"]:
            print(f"{part['id']}: {part['state']}: {part['why']}")
