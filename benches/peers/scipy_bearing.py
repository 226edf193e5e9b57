"""scipy's solve_ivp on the program's own equations (set A, bearing 3): error and processor time.

Reads target/peers/modal.csv, the reduced model (12 modes and 2 attachment shapes a plane) and its reference motion, both
written by the test `reference_for_peers`. DOP853 and Radau, restarted at the edges of the defect or not. See README.md.
"""

import argparse
import csv
import math
import time

import numpy as np
import scipy
from scipy.integrate import solve_ivp

INCH = 0.0254
OMEGA = 2.0 * math.pi * 40.0
FACTOR, INTERFERENCE, DAMPING, BALLS, CAGE = 9.239e9, 0.5e-6, 200.0, 11, 0.3816793893129771
SUPPORT = 1.078e8  # N/m
WIDTH, DEPTH, RADIUS = 0.05 * INCH, 4e-3 * INCH, 0.50325 * INCH
SEAT = 2.0 * math.pi * np.arange(BALLS) / BALLS
HALF = 0.5 * WIDTH / RADIUS


def read(path):
    """The model's lists by name, and the reference: time, x, y of the right bearing."""
    lists, motion = {}, []
    with open(path, newline="") as file:
        for row in csv.reader(file):
            if row[0] == "motion":
                motion.append([float(x) for x in row[1:]])
            else:
                lists[row[0]] = np.array([float(x) for x in row[1:]])
    return lists, np.array(motion)


class Bearing:
    """q'' = −2ζωq' − ω²q + turning force + Φᵀ(contacts), both planes."""

    def __init__(self, lists):
        self.omega, self.damping = lists["omega_rad_per_s"], lists["damping"]
        self.real, self.imaginary = lists["force_real"], lists["force_imaginary"]
        self.rows = [lists["left"], lists["right"]]
        self.n = len(self.rows[0])
        self.n_calls = 0

    def slope(self, t, state):
        self.n_calls += 1
        q, v = np.split(state, 2)
        shaft = OMEGA * t
        force = self.real * math.cos(shaft) - self.imaginary * math.sin(shaft)
        angle = SEAT + CAGE * shaft
        cos, sin = np.cos(angle), np.sin(angle)
        psi = SEAT + (CAGE - 1.0) * shaft
        psi -= 2.0 * math.pi * np.round(psi / (2.0 * math.pi))
        drop = np.where(np.abs(psi) <= HALF, DEPTH, 0.0)
        n = self.n
        for k, row in enumerate(self.rows):
            x, y, vx, vy = row @ q[:n], row @ q[n:], row @ v[:n], row @ v[n:]
            approach = x * cos + y * sin + INTERFERENCE - (drop if k == 1 else 0.0)
            load = FACTOR * np.maximum(approach, 0.0) ** 1.5
            force[:n] += row * (SUPPORT * x - load @ cos - DAMPING * vx)
            force[n:] += row * (SUPPORT * y - load @ sin - DAMPING * vy)
        return np.concatenate([v, force - 2.0 * self.damping * self.omega * v - self.omega**2 * q])


def edges(seconds):
    """Times at which a ball enters or leaves the defect."""
    rate = (1.0 - CAGE) * OMEGA
    found = set()
    for seat in SEAT:
        for side in (-HALF, HALF):
            first = (seat - side) % (2.0 * math.pi) / rate
            found.update(np.arange(first, seconds, 2.0 * math.pi / rate))
    return sorted(t for t in found if t > 0.0)


def solve(bearing, method, tolerance, times, is_aligned):
    """Displacement of the right bearing at `times`, and processor time, s."""
    seconds, row, n = times[-1], bearing.rows[1], bearing.n
    cuts = (edges(seconds) if is_aligned else []) + [seconds]
    state, at, parts = np.zeros(4 * n), 0.0, []
    begun = time.process_time()
    for cut in cuts:
        wanted = times[(times >= at) & (times < cut)]
        # Just inside, so that a side of the edge is never mistaken.
        inside = (at + 1e-13, cut - 1e-13)
        found = solve_ivp(bearing.slope, inside, state, method, np.clip(np.append(wanted, inside[1]), *inside), rtol=tolerance, atol=1e-9 * tolerance)
        state = found.y[:, -1]
        parts.append(found.y[:, :-1])
        at = cut
    parts.append(state[:, None])
    spent = time.process_time() - begun
    q = np.concatenate(parts, axis=1)
    return np.stack([row @ q[:n], row @ q[n : 2 * n]], axis=1), spent


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("model", help="target/peers/modal.csv")
    arguments = parser.parse_args()
    lists, motion = read(arguments.model)
    times, exact = motion[:, 0], motion[:, 1:]
    bearing = Bearing(lists)
    print(f"scipy {scipy.__version__}, {bearing.n} shapes a plane, record of {times[-1]:.4f} s")
    print("| method | tolerance | error | evaluations | processor time a simulated second, s |\n|---|---|---|---|---|")
    for method, is_aligned, tolerances in (
        ("DOP853", True, (1e-3, 1e-5, 1e-7, 1e-9)),
        ("DOP853", False, (1e-3, 1e-5, 1e-7)),
        ("Radau", True, (1e-3, 1e-5, 1e-7)),
    ):
        for tolerance in tolerances:
            bearing.n_calls = 0
            found, spent = solve(bearing, method, tolerance, times, is_aligned)
            gap = np.abs(found - exact).max(axis=0)
            error = (gap / np.abs(exact).max(axis=0)).max()
            name = f"{method}, {'restarted at edges' if is_aligned else 'straight on'}"
            print(f"| {name} | {tolerance:.0e} | {error:.1e} | {bearing.n_calls} | {spent / times[-1]:.1f} |", flush=True)


if __name__ == "__main__":
    main()
