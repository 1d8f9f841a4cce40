# SPDX-License-Identifier: Apache-2.0
"""The package's metadata, and what is found out while it is built: see also pyproject.toml."""

import ast
import platform
import sys
import zlib
from glob import glob
from pathlib import Path

from setuptools import Extension, find_packages, setup

package_name = "tactile_skin"
home = "https://example.org/tactile_skin"  # as maintainer_email: until there is a public one
# `colcon build --symlink-install` runs a link to this file, in a folder without README
readme = Path(__file__).resolve().with_name("README.md")


def literal(path: str, name: str):
    """A constant of a module, read without importing what may not be installed yet."""
    tree = ast.parse(Path(package_name, path).read_text(encoding="utf-8"))
    values = {t.id: s.value for s in tree.body if isinstance(s, ast.Assign) for t in s.targets}
    return ast.literal_eval(values[name])


programs = ["tactile-skin = tactile_skin.__main__:main"]
# colcon runs `setup.py install` or `develop`: setup.cfg sends the programs to lib/tactile_skin,
# where `ros2 run` looks for the nodes. pip runs neither, and would put a `monitor` on users' PATH.
if {"install", "develop"} & set(sys.argv):
    programs += [
        f"{name} = tactile_skin.__main__:{name}"
        for name in ("skin", *literal("middleware/package.py", "NODES"))
    ]
sources = sorted(glob(f"{package_name}/physics/compiled/*.c"))
# by which the package tells that what was compiled is not of the sources beside it
checksum = zlib.crc32(b"".join(Path(source).read_bytes() for source in sources))
# no index wraps around; Python's own flags say that they may, which keeps loops from vectors
flags = ["-O3", "-fno-wrapv"]
loops = {"_loops": flags}
if platform.machine() in ("x86_64", "AMD64"):  # used where the processor has them
    loops["_loops_avx2"] = [*flags, "-mavx2", "-mfma"]

setup(
    name=package_name,
    version=literal("__init__.py", "__version__"),
    description="A robot's skin from a low-cost resistive pressure matrix",
    long_description=readme.read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    keywords="robotics ros2 tactile sensor skin textile pressure matrix cross-talk compensation",
    project_urls={
        "Documentation": f"{home}/docs",
        "Changelog": f"{home}/blob/main/CHANGELOG.rst",
        "Source": home,
    },
    classifiers=[
        "Development Status :: 4 - Beta",
        "Intended Audience :: Developers",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        "Programming Language :: C",
        "Programming Language :: Python :: 3",
        *(f"Programming Language :: Python :: 3.{minor}" for minor in range(10, 14)),
        "Topic :: Scientific/Engineering",
        "Topic :: System :: Hardware :: Hardware Drivers",
        "Typing :: Typed",
    ],
    maintainer="The tactile_skin developers",
    maintainer_email="tactile_skin@example.org",
    python_requires=">=3.10",
    packages=find_packages(include=[package_name, f"{package_name}.*"]),
    package_data={
        package_name: [
            "py.typed",
            "learning/weights/*",
            "simulation/pictures/*",
            "physics/adc_tables/*",
            "physics/compiled/*.c",
            "findings/words.csv",
            "board/firmware/*.c",
            "board/firmware/*.h",
            "view/page/*",
        ]
    },
    # optional: without a compiler NumPy does the same, in up to twice the time
    ext_modules=[
        Extension(
            f"{package_name}.physics.compiled.{name}",
            sources,
            define_macros=[("SOURCE", f"{checksum}u")],
            extra_compile_args=flags,
            optional=True,
        )
        for name, flags in loops.items()
    ],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
        (f"share/{package_name}/launch", sorted(glob("launch/*"))),
        (f"share/{package_name}/config", sorted(glob("config/*"))),
        (f"share/{package_name}/examples", sorted(glob("examples/*.*"))),
        (f"share/{package_name}/examples/robot", sorted(glob("examples/robot/*.*"))),
    ],
    install_requires=[
        "numpy>=1.26",
        "scipy>=1.11",
        "pyserial>=3.5",
        "pyyaml>=6.0",
        "ruamel.yaml>=0.18",
        "threadpoolctl>=3.0",
    ],
    extras_require={
        "train": ["torch>=2.1", "tqdm>=4.66"],
        "progress": ["tqdm>=4.66"],  # of benchmarks
        "record": ["mcap>=1.6", "rosbags>=0.10", "joblib>=1.3"],
        "lerobot": [
            "mcap>=1.6",
            "rosbags>=0.10",
            "pandas>=2.0",
            "pyarrow>=15.0",
        ],  # --export lerobot
        "mujoco": ["mujoco>=3.0"],
        "gestures": ["scikit-learn>=1.3"],  # to train, not to name
        "view": ["websockets>=14.0"],
        "charts": ["matplotlib>=3.8"],
        "docs": ["mkdocs>=1.6,<2", "mkdocs-material>=9.5"],
        "completion": ["argcomplete>=3.0"],  # of the command, in a shell
        "test": [
            "argcomplete>=3.0",
            "distributed>=2024.1; python_version >= '3.11'",  # a cluster of this computer
            "hypothesis>=6.100",
            "joblib>=1.3",
            "mcap>=1.6",
            "mcap-ros2-support>=0.5",  # reads recordings independently
            "mypy>=1.10",
            "pytest>=8.0",
            "pytest-rerunfailures>=16.7",
            "rosbags>=0.10",
            "ruff>=0.15",
            "scikit-learn>=1.3",
            "setuptools>=70.1",  # builds the wheel
            "tqdm>=4.66",
            "websockets>=14.0",
        ],
    },
    entry_points={"console_scripts": programs},
    zip_safe=False,
)
