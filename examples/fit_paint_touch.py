"""Fit a swatch to a recording, paint it onto part of a mesh, touch the scene, save it and load it again."""

from pathlib import Path

import numpy as np
import trimesh

import hapscene

RATE_HZ = 10_000.0

# A recording of ten seconds, synthesised: noise drives a resonance at 180 Hz.
rng = np.random.default_rng(0)
a = np.poly([0.996 * np.exp(2j * np.pi * 180.0 / RATE_HZ * sign) for sign in (1, -1)]).real
noise = rng.standard_normal(100_000)
vibration = np.zeros(len(noise))
for k in range(2, len(noise)):
    vibration[k] = noise[k] - a[1] * vibration[k - 1] - a[2] * vibration[k - 2]
table = np.column_stack([vibration, np.full(len(noise), 1.0), np.full(len(noise), 0.1)])
np.savetxt("oak.csv", table, delimiter=",", header="acceleration,force,speed", comments="")

# Fit the swatch, and print what could not be measured.
units = {"acceleration": "m/s2", "force": "N", "speed": "m/s"}
recording = hapscene.capture.load_recording("oak.csv", rate_Hz=RATE_HZ, units=units)
oak = hapscene.capture.fit_swatch(recording, hapscene.capture.FitOptions("oak"))
print(recording)
print(oak)
print(*(f"  {what}: {why}" for what, why in oak.absent.items()), sep="\n")
hapscene.save_swatch(oak, "oak.swatch")

# Paint half of a plate with oak, half with leather.
scene = hapscene.Scene()
plate = trimesh.creation.box((0.1, 0.1, 0.02)).subdivide().subdivide().subdivide()
scene.add(plate, name="plate", unit="m", swatch="leather")
scene.paint("plate", "oak.swatch", hapscene.scene.Box((-0.05, -0.05, -0.02), (0.0, 0.05, 0.02)))

# Stroke from one to the other.
t_s = np.arange(1000) * 1e-3
p_WT = np.column_stack([-0.04 + 0.08 * t_s, np.zeros(1000), np.full(1000, 0.009)])
p_WT[0, 2] = 0.011
felt = hapscene.Renderer(scene, seed=1).run(p_WT)
crossed = [felt.swatch_names[index] for index in dict.fromkeys(felt.swatch[felt.touching].tolist())]
print(felt, "over", " then ".join(crossed))
felt.save("touch.npz")
scene.save("plate.scene.json")

assert crossed == ["oak", "leather"]
spectrum = np.abs(np.fft.rfft(felt.a_m_s2[100:450].ravel() * np.hanning(3500)))
peak_Hz = float(np.argmax(spectrum) * RATE_HZ / 3500)
assert abs(peak_Hz - 180.0) < 20.0, peak_Hz  # the resonance of the recording
again = hapscene.Renderer(hapscene.load_scene("plate.scene.json"), seed=1).run(p_WT)
assert np.array_equal(again.f_W_N, felt.f_W_N) and np.array_equal(again.a_m_s2, felt.a_m_s2)
print("made:", *sorted(file.name for file in Path().iterdir()))
