"""ROSS 2.3.0 on the rig with a damaged ball bearing (set A, bearing 3): error and processor time by step.

Same finite elements as the reference (24 Timoshenko elements, no modal damping, all shapes). The Hertz force goes in
through `add_to_RHS`, which sees the state one step back. Assembly and a warming run are not counted.
See README.md in this folder.
"""

import argparse
import contextlib
import csv
import io
import math
import time

import numpy as np

with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    import ross as rs

INCH = 0.0254
SUPPORT = 1.078e8  # N/m
OMEGA = 2.0 * math.pi * 40.0
FACTOR, INTERFERENCE, DAMPING, BALLS, CAGE = 9.239e9, 0.5e-6, 200.0, 11, 0.3816793893129771
WIDTH, DEPTH, RADIUS = 0.05 * INCH, 4e-3 * INCH, 0.50325 * INCH
BEARINGS, DISCS = (3.5148 * INCH, 17.4852 * INCH), (7.2985 * INCH, 13.7015 * INCH)


def rig():
    """The rotor, and the nodes of bearings and discs."""
    steel = rs.Material(name="steel", rho=7833.4, E=206.8427e9, Poisson=0.29)
    places = sorted([0.0, *BEARINGS, *DISCS, 10.5 * INCH, 21.0 * INCH])
    nodes = [0.0]
    for a, b in zip(places, places[1:]):
        nodes += [a + (b - a) * k / 4 for k in range(1, 5)]
    at = lambda place: min(range(len(nodes)), key=lambda i: abs(nodes[i] - place))
    shaft = [
        rs.ShaftElement(L=b - a, idl=0.0, odl=0.625 * INCH, material=steel)
        for a, b in zip(nodes, nodes[1:])
    ]
    outer, inner, width = 3.0 * INCH, 0.3125 * INCH, 0.625 * INCH
    mass = 2700.0 * math.pi * (outer**2 - inner**2) * width
    polar = 0.5 * mass * (outer**2 + inner**2)
    diametral = mass / 12.0 * (3.0 * (outer**2 + inner**2) + width**2)
    discs = [rs.DiskElement(n=at(place), m=mass, Id=diametral, Ip=polar) for place in DISCS]
    rings = [rs.DiskElement(n=at(place), m=0.05, Id=0.0, Ip=0.0) for place in BEARINGS]
    seats = [
        rs.BearingElement(n=at(place), kxx=SUPPORT, kyy=SUPPORT, cxx=DAMPING, cyy=DAMPING)
        for place in BEARINGS
    ]
    rotor = rs.Rotor(shaft, discs + rings, seats)
    return rotor, [at(place) for place in BEARINGS], [at(place) for place in DISCS], mass


def integrate(rotor, bearings, discs, mass, step, seconds, **options):
    """Displacement of the right bearing at every step, and processor time, s."""
    n = round(seconds / step) + 1
    t = np.arange(n) * step
    dof = rotor.number_dof
    force = np.zeros((n, rotor.ndof))
    for node in discs:
        force[:, dof * node] = mass * 100e-6 * OMEGA**2 * np.cos(OMEGA * t)
        force[:, dof * node + 1] = mass * 100e-6 * OMEGA**2 * np.sin(OMEGA * t)
    seat = 2.0 * math.pi * np.arange(BALLS) / BALLS
    half = 0.5 * WIDTH / RADIUS

    def contacts(index, disp_resp=None, **_):
        out = np.zeros(rotor.ndof)
        shaft = OMEGA * t[index]
        angle = seat + CAGE * shaft
        cos, sin = np.cos(angle), np.sin(angle)
        psi = seat + (CAGE - 1.0) * shaft
        psi -= 2.0 * math.pi * np.round(psi / (2.0 * math.pi))
        drop = np.where(np.abs(psi) <= half, DEPTH, 0.0)
        for k, node in enumerate(bearings):
            x, y = disp_resp[dof * node], disp_resp[dof * node + 1]
            approach = x * cos + y * sin + INTERFERENCE - (drop if k == 1 else 0.0)
            load = FACTOR * np.maximum(approach, 0.0) ** 1.5
            out[dof * node] = SUPPORT * x - load @ cos
            out[dof * node + 1] = SUPPORT * y - load @ sin
        return out

    before = time.process_time()
    with contextlib.redirect_stdout(io.StringIO()):
        result = rotor.run_time_response(OMEGA, force, t, method="newmark", add_to_RHS=contacts, **options)
    spent = time.process_time() - before
    right = dof * bearings[1]
    return t, result.yout[:, right : right + 2], spent


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("reference", help="target/peers/bearing.csv")
    parser.add_argument("--steps", default="1e-5,5e-6,2e-6,1e-6", help="s, dividing 20 µs")
    parser.add_argument("--tol", type=float, default=1e-6, help="of the Newton iteration, N")
    arguments = parser.parse_args()
    with open(arguments.reference, newline="") as file:
        rows = [[float(x) for x in row] for row in list(csv.reader(file))[1:]]
    exact = np.array(rows)
    grid, seconds = exact[1, 0] - exact[0, 0], exact[-1, 0]
    rotor, bearings, discs, mass = rig()
    integrate(rotor, bearings, discs, mass, 1e-5, 1e-3)
    print(f"ROSS {rs.__version__}, {rotor.ndof} degrees of freedom, record of {seconds:.4f} s")
    print("| step, µs | error | processor time a simulated second, s |\n|---|---|---|")
    for step in (float(word) for word in arguments.steps.split(",")):
        every = round(grid / step)
        _, found, spent = integrate(
            rotor, bearings, discs, mass, step, seconds, tol=arguments.tol
        )
        gap = np.abs(found[::every] - exact[:, 1:]).max(axis=0)
        error = (gap / np.abs(exact[:, 1:]).max(axis=0)).max()
        print(f"| {step * 1e6:g} | {error:.1e} | {spent / seconds:.0f} |", flush=True)


if __name__ == "__main__":
    main()
