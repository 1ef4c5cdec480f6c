"""One kind of gear."""

from dataclasses import dataclass

from aerarm_ros.description.config_error import check_name, check_range


@dataclass(frozen=True, slots=True)
class GearConfig:
    """A reduction gear, thesis section 4.2.

    Attributes
    ----------
    kind : str
        E.g. 'cycloidal'.
    ratio : float
        k_g = joint speed / motor speed, thesis (4.6); below one for a reduction.
    efficiency : float
        eta_g of thesis (4.7).

    Raises
    ------
    ConfigError
        If a value lies outside its range, such as a ratio given upside down.
    """

    kind: str
    ratio: float
    efficiency: float = 1.0

    def __post_init__(self) -> None:
        """Check every value."""
        check_name('gear', 'kind', self.kind)
        owner = f'gear {self.kind}'
        check_range(owner, 'ratio (joint speed / motor speed)', self.ratio, 1e-4, 1.0, '')
        check_range(owner, 'efficiency', self.efficiency, 0.01, 1.0, '')
