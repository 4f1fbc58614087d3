"""Values of numpy and scipy that test/bb/math/reference_test.exs holds BB.Math to.

usage: reference.py write FILE    computes the cases anew
       reference.py check FILE    computes the results of the file's cases again, and compares

A case is an Erlang term on a line: {function, [argument, ...], result}. Vectors [x, y, z],
quaternions [w, x, y, z], rotation matrices (three rows) and transforms (four rows) are lists.
"""

import ast
import math
import re
import sys

import numpy as np
from scipy.linalg import expm
from scipy.spatial.transform import Rotation, Slerp

TOLERANCE = 1e-10


def skew(v):
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def unit(v):
    return np.asarray(v) / np.linalg.norm(v)


def from_wxyz(q):
    return Rotation.from_quat(np.roll(q, -1))


def wxyz(rotation):
    return np.roll(rotation.as_quat(), 1)


def about(axis, angle):
    """The rotation matrix by the exponential series."""
    return expm(angle * skew(axis))


def homogeneous(rotation=np.eye(3), translation=(0, 0, 0)):
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = translation
    return matrix


def planar(x, y, theta):
    c, s = math.cos(theta), math.sin(theta)
    return np.array([[c, -s, x], [s, c, y], [0, 0, 1]])


def plane_basis(normal):
    n = unit(normal)
    u = unit(np.cross([0, 1, 0] if abs(n[2]) >= 0.9 else [0, 0, 1], n))
    return [u, np.cross(n, u)]


def lift(x, y, theta, normal):
    u, v = plane_basis(normal)
    return homogeneous(about(unit(normal), theta), x * u + y * v)


def multiply(a, b):
    """Hamilton's product by the matrix of the left factor, which keeps the sign."""
    w, v = a[0], np.asarray(a[1:])
    matrix = np.block([[np.array([[w]]), -v[None, :]], [v[:, None], w * np.eye(3) + skew(v)]])
    return matrix @ b


def axis_angle(q):
    v = np.linalg.norm(q[1:])
    return [np.asarray(q[1:]) / v, 2 * math.acos(q[0])]


def planar_product(a, b):
    return np.append((planar(*a) @ planar(*b))[:2, 2], a[2] + b[2])


def planar_inverse(t):
    return np.append(np.linalg.inv(planar(*t))[:2, 2], -t[2])


def origin(position, orientation):
    rotation = Rotation.from_euler("XYZ", orientation).as_matrix()
    return homogeneous(rotation) @ homogeneous(translation=position)


def two_vectors(a, b):
    axis = unit(np.cross(a, b))
    return wxyz(Rotation.from_rotvec(axis * math.acos(np.dot(unit(a), unit(b)))))


def slerp(a, b, t):
    return wxyz(Slerp([0, 1], Rotation.concatenate([from_wxyz(a), from_wxyz(b)]))(t))


FUNCTIONS = {
    "vec3_add": np.add,
    "vec3_subtract": np.subtract,
    "vec3_scale": np.multiply,
    "vec3_dot": np.dot,
    "vec3_cross": np.cross,
    "vec3_magnitude": np.linalg.norm,
    "vec3_magnitude_squared": lambda v: np.dot(v, v),
    "vec3_normalise": unit,
    "vec3_distance": lambda a, b: np.linalg.norm(np.subtract(a, b)),
    "vec3_lerp": lambda a, b, t: [np.interp(t, [0, 1], pair) for pair in zip(a, b)],
    "quaternion_new": unit,
    "quaternion_multiply": multiply,
    "quaternion_inverse": lambda q: wxyz(from_wxyz(q).inv()),
    "quaternion_from_axis_angle": lambda axis, angle: wxyz(
        Rotation.from_rotvec(unit(axis) * angle)
    ),
    "quaternion_to_axis_angle": axis_angle,
    "quaternion_from_euler_xyz": lambda *angles: wxyz(Rotation.from_euler("XYZ", angles)),
    "quaternion_from_euler_zyx": lambda *angles: wxyz(Rotation.from_euler("xyz", angles)),
    "quaternion_to_euler_xyz": lambda q: from_wxyz(q).as_euler("XYZ"),
    "quaternion_to_euler_zyx": lambda q: from_wxyz(q).as_euler("xyz"),
    "quaternion_from_two_vectors": two_vectors,
    "quaternion_from_rotation_matrix": lambda rows: wxyz(Rotation.from_matrix(rows)),
    "quaternion_to_rotation_list": lambda q: from_wxyz(q).as_matrix(),
    "quaternion_rotate_vector": lambda q, v: from_wxyz(q).apply(v),
    "quaternion_angular_distance": lambda a, b: (from_wxyz(a).inv() * from_wxyz(b)).magnitude(),
    "quaternion_power": lambda q, factor: wxyz(from_wxyz(q) ** factor),
    "quaternion_slerp": slerp,
    "transform_compose": np.matmul,
    "transform_compose_all": lambda *ts: np.linalg.multi_dot(ts),
    "transform_inverse": np.linalg.inv,
    "transform_from_axis_angle": lambda axis, angle: homogeneous(about(axis, angle)),
    "transform_rotation_x": lambda angle: homogeneous(about([1, 0, 0], angle)),
    "transform_rotation_y": lambda angle: homogeneous(about([0, 1, 0], angle)),
    "transform_rotation_z": lambda angle: homogeneous(about([0, 0, 1], angle)),
    "transform_translation_along": lambda axis, d: homogeneous(translation=np.multiply(axis, d)),
    "transform_from_position_quaternion": lambda p, q: homogeneous(from_wxyz(q).as_matrix(), p),
    "transform_get_quaternion": lambda t: wxyz(Rotation.from_matrix(np.array(t)[:3, :3])),
    "transform_apply_to_point": lambda t, p: (np.array(t) @ np.append(p, 1))[:3],
    "transform_from_origin": origin,
    "transform2d_compose": planar_product,
    "transform2d_inverse": planar_inverse,
    "transform2d_plane_basis": plane_basis,
    "transform2d_to_transform": lift,
    "covariance3_rotate": lambda c, q: from_wxyz(q).as_matrix() @ c @ from_wxyz(q).as_matrix().T,
}

# The arguments of a function, by one letter each: n any number, f a fraction, a an angle, v a
# vector, d a direction, q a rotation, r its matrix, t a transform, p a planar transform, c a
# covariance.
ARGUMENTS = {
    "vec3_add": "vv", "vec3_subtract": "vv", "vec3_scale": "vn", "vec3_dot": "vv",
    "vec3_cross": "vv", "vec3_magnitude": "v", "vec3_magnitude_squared": "v",
    "vec3_normalise": "v", "vec3_distance": "vv", "vec3_lerp": "vvf",
    "quaternion_new": "4", "quaternion_multiply": "qq", "quaternion_inverse": "q",
    "quaternion_from_axis_angle": "va", "quaternion_to_axis_angle": "q",
    "quaternion_from_euler_xyz": "aaa", "quaternion_from_euler_zyx": "aaa",
    "quaternion_to_euler_xyz": "q", "quaternion_to_euler_zyx": "q",
    "quaternion_from_two_vectors": "vv", "quaternion_from_rotation_matrix": "r",
    "quaternion_to_rotation_list": "q", "quaternion_rotate_vector": "qv",
    "quaternion_angular_distance": "qq", "quaternion_power": "qf", "quaternion_slerp": "qqf",
    "transform_compose": "tt", "transform_compose_all": "tttt", "transform_inverse": "t",
    "transform_from_axis_angle": "da", "transform_rotation_x": "a", "transform_rotation_y": "a",
    "transform_rotation_z": "a", "transform_translation_along": "dn",
    "transform_from_position_quaternion": "vq", "transform_get_quaternion": "t",
    "transform_apply_to_point": "tv", "transform_from_origin": "vA",
    "transform2d_compose": "pp", "transform2d_inverse": "p", "transform2d_plane_basis": "v",
    "transform2d_to_transform": "nnav", "covariance3_rotate": "cq",
}  # fmt: skip


def argument(random, kind):
    vector = random.uniform(-10, 10, 3)
    angle = random.uniform(-math.pi, math.pi)
    rotation = Rotation.from_rotvec(unit(random.normal(size=3)) * angle)

    return {
        "n": lambda: random.uniform(-10, 10),
        "f": lambda: random.uniform(0, 1),
        "a": lambda: random.uniform(-math.pi, math.pi),
        "A": lambda: random.uniform(-math.pi, math.pi, 3),
        "v": lambda: vector,
        "d": lambda: unit(vector),
        "4": lambda: random.uniform(-10, 10, 4),
        # Both signs of the real part.
        "q": lambda: wxyz(rotation) * random.choice([-1, 1]),
        "r": rotation.as_matrix,
        "t": lambda: homogeneous(rotation.as_matrix(), vector),
        "p": lambda: np.append(vector[:2], random.uniform(-10, 10)),
        "c": lambda: (lambda m: m @ m.T)(random.uniform(-1, 1, (3, 3))),
    }[kind]()


def write(file, count=10):
    random = np.random.default_rng(13)

    with open(file, "w") as out:
        print("%% Made by reference.py from numpy and scipy.", file=out)
        for name, kinds in ARGUMENTS.items():
            for _ in range(count):
                arguments = [plain(argument(random, kind)) for kind in kinds]
                result = plain(FUNCTIONS[name](*arguments))
                print(f"{{{name}, {term(arguments)}, {term(result)}}}.", file=out)


def plain(value):
    if isinstance(value, (list, tuple)):
        return [plain(element) for element in value]
    return np.asarray(value, dtype=float).tolist()


def term(value):
    """Erlang's floats have digits on both sides of the point."""
    if isinstance(value, list):
        return "[" + ", ".join(term(element) for element in value) + "]"
    text = repr(float(value))
    return text if "." in text else text.replace("e", ".0e")


def check(file):
    cases = 0
    with open(file) as source:
        lines = source.readlines()
    for number, line in enumerate(lines, 1):
        case = re.fullmatch(r"\{(\w+), (.*)\}\.\n", line)
        if not case:
            assert line.startswith("%"), f"line {number} is no case: {line}"
            continue
        arguments, expected = ast.literal_eval(f"({case[2]})")
        result = plain(FUNCTIONS[case[1]](*arguments))
        if differ(result, expected):
            sys.exit(f"{file}:{number}: expected {case[1]} to be {result}")
        cases += 1
    assert cases >= 400, f"{file} has only {cases} cases"
    print(f"numpy {np.__version__} has the results of all {cases} cases")


def differ(result, expected):
    result, expected = flat(result), flat(expected)
    return len(result) != len(expected) or not np.allclose(result, expected, TOLERANCE, TOLERANCE)


def flat(value):
    return sum(map(flat, value), []) if isinstance(value, list) else [value]


if __name__ == "__main__":
    command, file = sys.argv[1:]
    {"write": write, "check": check}[command](file)
