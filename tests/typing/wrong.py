"""Calls that a type checker rejects; an unnecessary comment, of a call that it accepts, is an error."""
# pyright: strict, reportUnnecessaryTypeIgnoreComment=true

import jhd
from jhd.typing import ShapeLike


def wrong(a: jhd.BezierCurve, surface: jhd.BSplineSurface, found: jhd.HausdorffSolution) -> None:
    jhd.hausdorff("not", a)  # pyright: ignore[reportArgumentType]
    jhd.hausdorff(a, 3)  # pyright: ignore[reportArgumentType]
    jhd.hausdorff(a, [a, a])  # pyright: ignore[reportArgumentType]
    jhd.hausdorff(a, [("0", "1")])  # pyright: ignore[reportArgumentType]
    jhd.hausdorff(a, found)  # pyright: ignore[reportArgumentType]
    jhd.hausdorff(a, {"control_points": [(0, 0)]})  # pyright: ignore[reportArgumentType]
    jhd.hausdorff(a, a, tolerance=1)  # pyright: ignore[reportCallIssue]
    jhd.hausdorff(a, a, 1e-6)  # pyright: ignore[reportArgumentType]
    jhd.hausdorff(a, a, jhd.BranchAndBound)  # pyright: ignore[reportArgumentType]
    jhd.hausdorff(a, a, atol="0.1%")  # pyright: ignore[reportArgumentType]
    jhd.deviation(a, a, box=1)  # pyright: ignore[reportCallIssue]
    jhd.project("p", a)  # pyright: ignore[reportArgumentType]
    jhd.project(a, (0, 0))  # pyright: ignore[reportArgumentType]
    jhd.nearest_shapes("abc", [a])  # pyright: ignore[reportArgumentType]
    jhd.minimize_hausdorff(lambda _: 3, 0.5, a)  # pyright: ignore[reportArgumentType]
    jhd.plot.solution(a, a, found, "axes")  # pyright: ignore[reportArgumentType]
    jhd.io.save_svg("a.svg", surface)  # pyright: ignore[reportArgumentType]
    jhd.BezierCurve([("0", "1")])  # pyright: ignore[reportArgumentType]
    jhd.BranchAndBound(atol="small")  # pyright: ignore[reportArgumentType]
    print(found.witnesses)  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType, reportUnknownArgumentType]


def text(shape: str) -> ShapeLike:
    return shape  # pyright: ignore[reportReturnType]
