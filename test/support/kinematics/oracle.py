"""Writes transforms.terms: the transforms between links of a robot, as Pinocchio computes them.

BB.Robot.KinematicsTest compares BB.Robot.transform/4 with this table, for a robot that it
declares with the same numbers as the URDF below. To write the table again:

    pip install pin==4.1.0
    python3 test/support/kinematics/oracle.py > test/support/kinematics/transforms.terms
"""

import random

import numpy
import pinocchio

# The axis of `wrist` is z turned by 10 degrees of roll and 20 degrees of pitch.
WRIST = (0.3420201433256687, -0.16317591116653482, 0.9254165783983234)

JOINTS = [
    # name, type, parent, child, xyz, rpy, axis
    ("shoulder", "revolute", "base", "upper", (0.1, -0.2, 0.3), (0.3, -0.5, 0.7), (0, 0, 1)),
    ("elbow", "continuous", "upper", "lower", (0.0, 0.25, 0.1), (-1.1, 0.4, 0.2), (0.6, 0, 0.8)),
    ("wrist", "revolute", "lower", "hand", (0.2, 0.0, 0.0), (0.0, 0.0, 1.5), WRIST),
    ("slide", "prismatic", "hand", "finger", (0.0, 0.03, 0.05), (0.2, 0.9, -0.4), (0, 1, 0)),
    ("mount", "fixed", "hand", "camera", (0.05, 0.02, 0.08), (2.1, -0.3, 1.2), None),
    ("table", "planar", "base", "cart", (-0.5, 0.6, 0.0), (0.1, 0.2, 0.3), (0, 0, 1)),
    ("free", "floating", "base", "drone", (0.0, 0.0, 1.0), (0.4, 0.5, 0.6), None),
]

LINKS = ["base"] + [joint[3] for joint in JOINTS]

PAIRS = [
    ("base", "upper"), ("base", "camera"), ("finger", "base"), ("camera", "finger"),
    ("lower", "lower"), ("cart", "finger"), ("drone", "camera"), ("cart", "drone"),
    ("hand", "upper"),
]


def numbers(values):
    return " ".join(repr(float(value)) for value in values)


def urdf():
    inertial = (
        '<inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    text = ['<robot name="oracle">']
    text += [f'<link name="{link}">{inertial}</link>' for link in LINKS]

    for name, kind, parent, child, xyz, rpy, axis in JOINTS:
        text.append(f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>')
        text.append(f'<child link="{child}"/><origin xyz="{numbers(xyz)}" rpy="{numbers(rpy)}"/>')
        if axis:
            text.append(f'<axis xyz="{numbers(axis)}"/>')
        if kind in ("revolute", "prismatic"):
            text.append('<limit lower="-3" upper="3" effort="1" velocity="1"/>')
        text.append("</joint>")

    return "".join(text + ["</robot>"])


def quaternion(rng):
    q = numpy.array([rng.gauss(0, 1) for _ in range(4)])
    return q / numpy.linalg.norm(q)


def position(kind, rng):
    if kind == "planar":
        return [rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-3, 3)]
    if kind == "floating":
        return [rng.uniform(-1, 1) for _ in range(3)] + list(quaternion(rng))
    return rng.uniform(-2, 2)


def configuration(model, positions):
    """Pinocchio's vector: cos and sin for endless angles, x y z w for quaternions."""
    q = pinocchio.neutral(model)
    for name, kind, *_ in JOINTS:
        if kind == "fixed":
            continue
        index, value = model.joints[model.getJointId(name)].idx_q, positions[name]
        if kind == "continuous":
            q[index:index + 2] = numpy.cos(value), numpy.sin(value)
        elif kind == "planar":
            q[index:index + 2] = value[:2]
            q[index + 2:index + 4] = numpy.cos(value[2]), numpy.sin(value[2])
        elif kind == "floating":
            q[index:index + 3] = value[:3]
            w, x, y, z = value[3:]
            q[index + 3:index + 7] = x, y, z, w
        else:
            q[index] = value
    return q


def term(value):
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(term(each) for each in value) + "]"
    text = repr(float(value))
    return text if "." in text else text.replace("e", ".0e")


def main():
    model = pinocchio.buildModelFromXML(urdf())
    data = model.createData()
    rng = random.Random(13)
    print("% Written by oracle.py, with Pinocchio " + pinocchio.__version__ + ".")
    print("% Each: the positions of the joints, then {from, to, matrix row by row}.")

    for _ in range(4):
        positions = {n: position(k, rng) for n, k, *_ in JOINTS if k != "fixed"}
        pinocchio.framesForwardKinematics(model, data, configuration(model, positions))
        print("{#{" + ", ".join(f"{n} => {term(v)}" for n, v in positions.items()) + "}, [")
        rows = []
        for start, end in PAIRS:
            frames = [data.oMf[model.getFrameId(link)] for link in (start, end)]
            matrix = (frames[0].inverse() * frames[1]).homogeneous
            rows.append(f"  {{{start}, {end}, {term(list(matrix.flatten()))}}}")
        print(",\n".join(rows) + "\n]}.")


main()
