import ast
from glob import glob
from pathlib import Path

from setuptools import Extension, find_packages, setup

package_name = "tactile_skin"


def nodes() -> list[str]:
    """The names in launch.NODES, read without importing what may not be installed yet."""
    tree = ast.parse(Path(package_name, "launch.py").read_text())
    tables = {t.id: s.value for s in tree.body if isinstance(s, ast.Assign) for t in s.targets}
    return list(ast.literal_eval(tables["NODES"]))


setup(
    name=package_name,
    version="0.1.0",
    description="A robot's skin from a low-cost resistive pressure matrix",
    license="Apache-2.0",
    maintainer="The tactile_skin developers",
    maintainer_email="tactile_skin@example.org",
    python_requires=">=3.10",
    packages=find_packages(include=[package_name, f"{package_name}.*"]),
    package_data={package_name: ["weights/*"]},
    # optional: without a compiler NumPy does the same, in twice the time
    ext_modules=[
        Extension(
            f"{package_name}._kernel",
            sorted(glob(f"{package_name}/kernel/*.c")),
            depends=[f"{package_name}/kernel/kernel.h"],
            extra_compile_args=["-O3"],
            optional=True,
        )
    ],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
        (f"share/{package_name}/launch", sorted(glob("launch/*.yaml"))),
        (f"share/{package_name}/config", sorted(glob("config/*"))),
    ],
    install_requires=[
        "numpy>=1.26",
        "scipy>=1.11",
        "torch>=2.1",
        "pyserial>=3.5",
        "pyyaml>=6.0",
        "threadpoolctl>=3.0",
    ],
    extras_require={
        "progress": ["tqdm>=4.66"],  # of training and benchmarks
        "charts": ["matplotlib>=3.8"],
        "onnx": ["onnx>=1.16", "onnxscript>=0.2"],  # of trained networks, to be run elsewhere
        "test": ["hypothesis>=6.100", "pytest>=8.0", "rosbags>=0.10", "ruff>=0.15", "tqdm>=4.66"],
    },
    entry_points={
        "console_scripts": [
            "tactile-skin = tactile_skin.cli:main",
            *(f"{name} = tactile_skin.ros:{name}" for name in nodes()),
        ]
    },
    zip_safe=False,
)
