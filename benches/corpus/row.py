"""Row of the corpus table: measurements of one model file.

The module `judge` has the criteria by which a row is judged, so that they can change without new measurements.
"""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Motion:
    """Motion of one engine in an episode.

    Attributes:
        mean_energy: Mean kinetic energy after a step, J.
        max_energy: Largest kinetic energy after a step, J.
        hinge_excess: Largest increase of a hinge's limit violation since the reference pose, rad.
        slide_excess: Largest increase of a slide's limit violation since the reference pose, m.
    """

    mean_energy: float = 0.0
    max_energy: float = 0.0
    hinge_excess: float = 0.0
    slide_excess: float = 0.0


@dataclass(frozen=True)
class Episode:
    """Episode of stepper and MuJoCo with the same controls from the reference pose.

    Attributes:
        steps: Number of steps; fewer than planned if the processor time ran out.
        not_converged: Fraction of stepper's steps with the flag NOT_CONVERGED.
        non_finite: Fraction of stepper's steps with NON_FINITE.
        contacts_full: Fraction of stepper's steps with CONTACTS_FULL.
        unresolved: Fraction of stepper's steps with UNRESOLVED.
        tunnelled: Fraction of stepper's steps with TUNNELLED.
        infeasible: Fraction of stepper's steps with INFEASIBLE.
        residual: Largest residual of stepper, m/s.
        ours: Motion of stepper.
        theirs: Motion of MuJoCo.
        warnings: Warnings of MuJoCo with their counts, such as "BADQACC:3".
    """

    steps: int = 0
    not_converged: float = 0.0
    non_finite: float = 0.0
    contacts_full: float = 0.0
    unresolved: float = 0.0
    tunnelled: float = 0.0
    infeasible: float = 0.0
    residual: float = 0.0
    ours: Motion = field(default_factory=Motion)
    theirs: Motion = field(default_factory=Motion)
    warnings: str = ""


MEASURED, FRAGMENT, STILL, SAME = "measured", "fragment", "nothing moves", "same model"
REFUSED, FAILED, LATE, ABSENT = "refused", "failed", "out of time", "not downloaded"


@dataclass(frozen=True)
class Row:
    """Measurements of one file of a package, as a row of the corpus table.

    Attributes:
        package: Name of the package.
        version: Version of the package.
        file: Path of the file in the package. The path is empty if the package cannot be downloaded.
        stepper: Digest of the build of stepper.
        outcome: Outcome: "measured", or the reason why not.
        note: Details of the outcome.
        model: Digest of the compiled model.
        nv: Number of degrees of freedom.
        nu: Number of controls.
        nbody: Number of bodies.
        ngeom: Number of geoms.
        nmesh: Number of meshes.
        timestep: Time step of the model, s.
        strict: Whether `stepper.load` accepts the complete model.
        missing: Kinds of elements that affect the motion and that `strict=False` omits, separated by "; ".
        load_seconds: Time of stepper to load the compiled model, s.
        compile_seconds: Time of MuJoCo to compile the model, s.
        overlap: Deepest overlap in the reference pose, m.
        hinge_outside: Largest limit violation of a hinge in the reference pose, rad.
        slide_outside: Largest limit violation of a slide in the reference pose, m.
        mass_error: Largest relative error of the mass matrix over some random states (`dynamics.agreement`).
        bias_error: Largest relative error of the bias force over the same states.
        acceleration_error: Largest relative error of the acceleration without constraints over the same states.
        random: Episode with random controls.
        rest: Episode with zero controls.
    """

    package: str
    version: str
    file: str
    stepper: str
    outcome: str
    note: str = ""
    model: str = ""
    nv: int = 0
    nu: int = 0
    nbody: int = 0
    ngeom: int = 0
    nmesh: int = 0
    timestep: float = 0.0
    strict: bool = False
    missing: str = ""
    load_seconds: float = 0.0
    compile_seconds: float = 0.0
    overlap: float = 0.0
    hinge_outside: float = 0.0
    slide_outside: float = 0.0
    mass_error: float = 0.0
    bias_error: float = 0.0
    acceleration_error: float = 0.0
    random: Episode = field(default_factory=Episode)
    rest: Episode = field(default_factory=Episode)

    @property
    def key(self) -> tuple[str, str, str]:
        """Package, version and file of the row."""
        return self.package, self.version, self.file
