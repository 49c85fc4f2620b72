"""Train the network of ``cpmkit_neural/spot.npz`` to the signed distance of Spot the cow, with NumPy alone.

python train.py     # one to three minutes; needs cpmkit-mesh, and spot.obj in CPMKIT_DATA or in the cache

The random numbers are seeded, but sums are rounded differently from one machine to the next, so
the network differs a little between machines; all are equally good.
"""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

import cpmkit as ck

LAYERS, WIDTH = 3, 48
STEPS, BATCH, RATE = 10_000, 4096, 5e-3
#: The box in which the network is trained is so much wider than the cow, which is 1.8 long, to each side.
MARGIN = 0.12
#: Spread of the first layer's weights: larger ones draw finer details, and ripples between them.
FREQUENCY = 5.0
#: Errors below ROUGH count as squares, above it as they are; distances count by 1 / (NEAR + distance).
ROUGH, NEAR = 0.003, 0.02


def training_data(count, rng):
    """Return points (n, 3), four of five near the cow, their signed distances (n,), and the corners of the box."""
    vertices, faces = ck.read_mesh("spot.obj")
    cow = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    corners = np.asarray(vertices)[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = corners[rng.choice(len(faces), count, p=area / area.sum())]
    x = np.einsum("nk,nkd->nd", rng.dirichlet([1, 1, 1], count), chosen)
    x += rng.choice([0.0, 0.01, 0.04, 0.12], (count, 1), p=[0.3, 0.3, 0.2, 0.2]) * rng.normal(size=x.shape)
    box = cow.bounds + MARGIN * np.array([[-1.0], [1.0]])
    x[: count // 5] = rng.uniform(*box, (count // 5, 3))
    x = x[((x > box[0]) & (x < box[1])).all(axis=1)]
    feet = cow.closest_point(x)
    outside = np.einsum("nd,nd->n", x - feet.points, cow.normals(feet)) > 0
    return x, np.where(outside, 1, -1) * np.linalg.norm(x - feet.points, axis=1), box


def fresh_network(rng):
    """Return weight, bias, weight, bias, ... with which each layer's sines start spread over a whole wave."""
    sizes = [3, *[WIDTH] * LAYERS, 1]
    parameters = []
    for inputs, outputs in pairwise(sizes):
        spread = FREQUENCY if inputs == 3 else np.sqrt(6 / inputs) * (0.1 if outputs == 1 else 1.0)
        parameters.append(rng.uniform(-spread, spread, (inputs, outputs)))
        parameters.append(rng.uniform(-np.pi, np.pi, outputs) if outputs > 1 else np.zeros(1))
    return [parameter.astype(np.float32) for parameter in parameters]


def loss_and_slopes(parameters, x, distance):
    """Return the mean weighted error of a batch, and its derivative by every parameter (backpropagation)."""
    inputs, cosines = [x], []
    for weight, bias in zip(parameters[:-2:2], parameters[1:-2:2], strict=True):
        angle = inputs[-1] @ weight + bias
        inputs.append(np.sin(angle))
        cosines.append(np.cos(angle))
    error = (inputs[-1] @ parameters[-2] + parameters[-1])[:, 0] - distance
    counts = 1 / (NEAR + np.abs(distance)) / len(x)
    rough = np.sqrt(error**2 + ROUGH**2)
    back = (counts * error / rough)[:, None]
    slopes = []
    for k in range(len(inputs) - 1, -1, -1):
        slopes = [inputs[k].T @ back, back.sum(axis=0), *slopes]
        if k:
            back = (back @ parameters[2 * k].T) * cosines[k - 1]
    return float((counts * rough).sum()), slopes


def train(parameters, x, distance, rng):
    """Change ``parameters`` in place by Adam (Kingma and Ba 2015), with a rate that rises and then falls to 0."""
    mean = [np.zeros_like(parameter) for parameter in parameters]
    square = [np.zeros_like(parameter) for parameter in parameters]
    for step in range(STEPS):
        batch = rng.integers(0, len(x), BATCH)
        loss, slopes = loss_and_slopes(parameters, x[batch], distance[batch])
        rate = float(RATE * min(1, step / 200) * 0.5 * (1 + np.cos(np.pi * step / STEPS)))  # keeps float32
        for parameter, slope, m, s in zip(parameters, slopes, mean, square, strict=True):
            m += 0.1 * (slope - m)
            s += 0.001 * (slope**2 - s)
            parameter -= rate * (m / (1 - 0.9 ** (step + 1))) / (np.sqrt(s / (1 - 0.999 ** (step + 1))) + 1e-8)
        if step % 1000 == 0:
            print(f"step {step:5d}  error {loss:.4f}", file=sys.stderr)


def main(target=Path(__file__).parent / "cpmkit_neural" / "spot.npz"):
    """Train a network and write it to ``target``."""
    rng = np.random.default_rng(0)
    x, distance, box = training_data(400_000, rng)
    parameters = fresh_network(rng)
    train(parameters, x.astype(np.float32), distance.astype(np.float32), rng)
    names = [f"{what}{k}" for k in range(LAYERS + 1) for what in ("weight", "bias")]
    np.savez_compressed(target, **dict(zip(names, parameters, strict=True)), bounds=np.round(box, 3))


if __name__ == "__main__":
    main()
