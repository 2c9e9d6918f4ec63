#!/usr/bin/env python3
"""Behavior cloning: from two small pictures, joint angles and torques to the set-points of the next 0.8 s.

python train.py data/lift policy.npz
"""

import argparse
import io
import json
import os
import pathlib

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads on such small matrices would wait for each other

import numpy as np

FPS, AHEAD = 10, 8  # actions per second, and in a chunk
SHOWN, HIDDEN = 24, 128  # principal components of the pictures; neurons of a layer


def small(pictures):
    """Pictures of 72 x 96 as a row of numbers from 0 to 1: means of 6 x 6 pixels."""
    return np.concatenate([p.reshape(12, 6, 16, 6, 3).mean((1, 3)).ravel() / 255 for p in pictures])


class Policy:
    """A network of two hidden layers. `weights`: what train() has found, or np.load() of its file."""

    def __init__(self, weights):
        self.w = dict(weights)

    def inputs(self, pixels, state):
        """Numbers of about the size of 1, a row each."""
        w = self.w
        seen = (pixels - w["pixel_mean"]) @ w["components"]
        return np.concatenate([seen / w["seen_scale"], (state - w["state_mean"]) / w["state_scale"]], axis=-1)

    def layers(self, x):
        one = np.tanh(x @ self.w["w1"] + self.w["b1"])
        two = np.tanh(one @ self.w["w2"] + self.w["b2"])
        return one, two, two @ self.w["w3"] + self.w["b3"]

    def __call__(self, pictures, state):
        """A chunk: AHEAD x 14 joint angles of both arms [rad]."""
        y = self.layers(self.inputs(small(pictures), state))[2]
        return (y * self.w["action_scale"] + self.w["action_mean"]).reshape(AHEAD, -1)


def read(folder):
    """(pixels, states, chunks of actions), a row per frame, and the first state of each episode."""
    import pyarrow.parquet as parquet
    from PIL import Image

    folder = pathlib.Path(folder)
    features = json.loads((folder / "meta/info.json").read_text())["features"]
    cameras = sorted(name for name in features if name.startswith("observation.images."))
    table = parquet.read_table(folder / "data").to_pydict()
    pixels = [
        small([np.asarray(Image.open(io.BytesIO(table[name][k]["bytes"]))) for name in cameras])
        for k in range(len(table["index"]))
    ]
    episode, action = np.array(table["episode_index"]), np.array(table["action"])
    last = np.searchsorted(episode, episode, side="right") - 1  # of each frame's episode
    ahead = np.minimum(np.arange(len(action))[:, None] + np.arange(1, AHEAD + 1), last[:, None])
    states = np.array(table["observation.state"])
    return np.array(pixels), states, action[ahead].reshape(len(action), -1), states[np.unique(episode, True)[1]]


def train(folder, steps, seed=1, say=print):
    """The weights, and the mean loss of each tenth of the steps."""
    random = np.random.default_rng(seed)
    pixels, states, chunks, first = read(folder)
    w = {"pixel_mean": pixels.mean(0), "state_mean": states.mean(0), "state_scale": states.std(0) + 0.01}
    w["components"] = np.linalg.svd(pixels - w["pixel_mean"], full_matrices=False)[2][:SHOWN].T
    w["seen_scale"] = ((pixels - w["pixel_mean"]) @ w["components"]).std(0) + 0.01
    w["action_mean"], w["action_scale"] = chunks.mean(0), chunks.std(0) + 0.01
    w["start_rad"] = first.mean(0).reshape(2, -1)[:, :7]  # where episodes begin
    policy = Policy(w)
    x, y = policy.inputs(pixels, states), (chunks - w["action_mean"]) / w["action_scale"]
    sizes = [x.shape[1], HIDDEN, HIDDEN, y.shape[1]]
    for k, (rows, columns) in enumerate(zip(sizes, sizes[1:]), 1):
        w[f"w{k}"], w[f"b{k}"] = random.normal(0, rows**-0.5, (rows, columns)), np.zeros(columns)
    policy.w = w
    names = ["w1", "b1", "w2", "b2", "w3", "b3"]
    mean, square = ({name: np.zeros_like(w[name]) for name in names} for _ in range(2))
    losses = []
    for step in range(1, steps + 1):
        rows = random.integers(len(x), size=256)
        # The arms will deviate from the demonstrations, and set-points must not follow that deviation.
        noisy = x[rows] + random.normal(0, 0.15, (256, x.shape[1]))
        one, two, out = policy.layers(noisy)
        error = out - y[rows]
        losses.append(np.mean(error**2))
        back3 = 2 * error / error.size
        back2 = back3 @ w["w3"].T * (1 - two**2)
        back1 = back2 @ w["w2"].T * (1 - one**2)
        gradients = [noisy.T @ back1, back1.sum(0), one.T @ back2, back2.sum(0), two.T @ back3, back3.sum(0)]
        rate = 2e-3 * (1 + np.cos(np.pi * step / steps)) / 2
        for name, gradient in zip(names, gradients):  # Adam
            mean[name] += 0.1 * (gradient - mean[name])
            square[name] += 0.001 * (gradient**2 - square[name])
            w[name] -= rate * mean[name] / (1 - 0.9**step) / (np.sqrt(square[name] / (1 - 0.999**step)) + 1e-8)
        if step % (steps // 10) == 0:
            say(f"step {step}: loss {np.mean(losses[-(steps // 10) :]):.5f}")
    return w, np.array(losses[: steps // 10 * 10]).reshape(10, -1).mean(1)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("data", help="the data set")
    parser.add_argument("policy", help="file to write")
    parser.add_argument("--steps", type=int, default=6000)
    options = parser.parse_args()
    weights, _ = train(options.data, options.steps)
    np.savez(options.policy, **weights)


if __name__ == "__main__":
    main()
