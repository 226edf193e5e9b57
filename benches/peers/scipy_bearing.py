"""scipy's integrators on the rig with a damaged ball bearing (set A, bearing 3): error and processor time by tolerance.

The equations are those of the reference (24 Timoshenko elements, no modal damping, Hertz force) in coordinates of the lateral shapes of
the rotor on its linear supports, all of them or the lowest. Assembly is not counted. See README.md in this folder.
"""

import argparse
import csv
import math
import time

import numpy as np
import scipy
import scipy.integrate
import scipy.linalg

from ross_bearing import BALLS, CAGE, DEPTH, FACTOR, INTERFERENCE, OMEGA, RADIUS, SUPPORT, WIDTH, rig


class Rotor:
    """Equations of motion in shapes: q'' = -A q' - w^2 q + P f(t, q)."""

    def __init__(self, n_shapes):
        rotor, bearings, discs, mass = rig()
        dof, damping = rotor.number_dof, rotor.C(OMEGA) + rotor.G() * OMEGA
        # Along the shaft and about it nothing moves: those coordinates are left out, which leaves lateral shapes alone.
        lateral = [i for i in range(rotor.ndof) if i % dof in (0, 1, 3, 4)] if dof == 6 else list(range(rotor.ndof))
        cut = np.ix_(lateral, lateral)
        square, shapes = scipy.linalg.eigh(rotor.K(0.0)[cut], rotor.M(0.0)[cut])
        square, shapes = square[:n_shapes], shapes[:, :n_shapes]
        self.n, self.square, self.damping = len(square), square, shapes.T @ damping[cut] @ shapes
        row = {place: i for i, place in enumerate(lateral)}
        at = lambda nodes: [shapes[[row[dof * node], row[dof * node + 1]]] for node in nodes]
        self.bearings, self.discs, self.unbalance = at(bearings), at(discs), mass * 100e-6 * OMEGA**2
        self.seat, self.half = 2.0 * math.pi * np.arange(BALLS) / BALLS, 0.5 * WIDTH / RADIUS
        self.calls = 0

    def slope(self, t, state):
        self.calls += 1
        q, v = state[: self.n], state[self.n :]
        shaft = OMEGA * t
        out = -self.square * q - self.damping @ v
        turning = self.unbalance * np.array([math.cos(shaft), math.sin(shaft)])
        for disc in self.discs:
            out += turning @ disc
        angle = self.seat + CAGE * shaft
        cos, sin = np.cos(angle), np.sin(angle)
        psi = self.seat + (CAGE - 1.0) * shaft
        psi -= 2.0 * math.pi * np.round(psi / (2.0 * math.pi))
        for k, bearing in enumerate(self.bearings):
            x, y = bearing @ q
            drop = np.where(np.abs(psi) <= self.half, DEPTH, 0.0) if k == 1 else 0.0
            load = FACTOR * np.maximum(x * cos + y * sin + INTERFERENCE - drop, 0.0) ** 1.5
            out += np.array([SUPPORT * x - load @ cos, SUPPORT * y - load @ sin]) @ bearing
        return np.concatenate([v, out])

    def record(self, method, tolerance, times):
        """Displacement of the right bearing at the times, and processor time, s."""
        self.calls = 0
        # A tolerance on each shape: relative to a micrometre of displacement.
        before = time.process_time()
        found = scipy.integrate.solve_ivp(
            self.slope,
            (0.0, times[-1]),
            np.zeros(2 * self.n),
            method,
            times,
            rtol=tolerance,
            atol=tolerance * self.scale(),
        )
        spent = time.process_time() - before
        if not found.success:
            raise SystemExit(f"{method}: {found.message}")
        return (self.bearings[1] @ found.y[: self.n]).T, spent

    def scale(self):
        """What each shape and its speed amount to when the bearings move by a micrometre."""
        shape = 1e-6 / max(np.abs(bearing).max() for bearing in self.bearings)
        return np.concatenate([np.full(self.n, shape), shape * np.sqrt(np.abs(self.square))])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("reference", help="target/peers/bearing.csv")
    parser.add_argument("--methods", default="DOP853,Radau")
    parser.add_argument("--tolerances", default="1e-4,1e-6,1e-8")
    parser.add_argument("--shapes", default="64,100", help="lowest lateral shapes")
    arguments = parser.parse_args()
    with open(arguments.reference, newline="") as file:
        exact = np.array([[float(x) for x in row] for row in list(csv.reader(file))[1:]])
    seconds, size = exact[-1, 0], np.abs(exact[:, 1:]).max(axis=0)
    print(f"scipy {scipy.__version__}, numpy {np.__version__}, record of {seconds:.4f} s")
    print("| shapes | method | tolerance | calls of the equations | error | processor time a simulated second, s |\n|---|---|---|---|---|---|")
    for shapes in (int(word) for word in arguments.shapes.split(",")):
        rotor = Rotor(shapes)
        for method in arguments.methods.split(","):
            for tolerance in (float(word) for word in arguments.tolerances.split(",")):
                found, spent = rotor.record(method, tolerance, exact[:, 0])
                error = (np.abs(found - exact[:, 1:]).max(axis=0) / size).max()
                print(
                    f"| {rotor.n} | {method} | {tolerance:g} | {rotor.calls} | {error:.1e} | {spent / seconds:.1f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
