#!/bin/bash
# Guess: the regressor times the inertial parameters of the links is the torque of rnea, for whatever model.
# So it is: rnea, crba, aba and computeKineticEnergy count the model's armature (rotors); computeJointTorqueRegressor and
# computeKineticEnergyRegressor do not, and armature is no parameter of theirs. Parameters that are identified with them put
# the rotors into the links; an identified model evaluated with rnea and armature counts them twice.
# The right number: the difference of the torques is armature times acceleration, of the energies 1/2 armature times speed squared.
# Seen with pin 4.1.0 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pin==4.1.0 numpy==2.4.6
"$folder/bin/python" - <<'END'
import numpy as np
import pinocchio as pin

random = np.random.default_rng(1)
model = pin.buildSampleModelManipulator()
model.armature[:] = random.uniform(0.1, 1, model.nv)
data = model.createData()
q = pin.neutral(model) + random.normal(size=model.nq)
v, a = random.normal(size=model.nv), random.normal(size=model.nv)
links = np.concatenate([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]])

torque = np.array(pin.rnea(model, data, q, v, a)) - np.array(pin.computeJointTorqueRegressor(model, data, q, v, a)) @ links
energy = pin.computeKineticEnergy(model, data, q, v) - np.array(pin.computeKineticEnergyRegressor(model, data, q, v)) @ links
print("rnea less regressor [N m]:", np.round(torque, 4), " armature times acceleration:", np.round(model.armature * a, 4))
print(f"energy less regressor [J]: {energy:.4f}, of the rotors: {model.armature @ v**2 / 2:.4f}")
assert np.allclose(torque, model.armature * a), "the regressor of torques has changed"
assert np.isclose(energy, model.armature @ v**2 / 2), "the regressor of energy has changed"
END
