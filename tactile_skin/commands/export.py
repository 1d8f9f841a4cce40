"""`tactile-skin export`: a trained network as ONNX."""

from __future__ import annotations

from pathlib import Path

EXAMPLES = (
    "examples:\n"
    "  tactile-skin export my_weights/paper.npz skin.onnx\n"
    "  tactile-skin export paper skin.onnx"
)


def register(parser) -> None:
    """Declare the arguments."""
    parser.epilog = EXAMPLES
    parser.add_argument(
        "weights", help="file that `train` made, or the shipped ones: paper, physics"
    )
    parser.add_argument("out", type=Path, help="file to write")


def run(args) -> int:
    """Write the file."""
    from ..learning import network

    shipped = args.weights in network.NETWORKS
    weights = network.shipped(args.weights) if shipped else network.load(args.weights)
    if args.out.is_dir() or not args.out.parent.is_dir():
        raise ValueError(f"{args.out}: must be a file in a folder that exists")
    from .. import extras

    extras.torch("onnx")
    from ..learning import export

    export.to_onnx(weights, args.out)
    print(f"{args.out}: {weights.kind} network, {weights.rows} x {weights.cols}, force in newton")
    return 0
