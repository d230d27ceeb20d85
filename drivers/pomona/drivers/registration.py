"""Declaration of a driver: the names of `pomona.executive.cell.registration`, which drivers import from here."""

from pomona.executive.cell.registration import (
    Driver as Driver,
    DriverSection as DriverSection,
    NoOptions as NoOptions,
    Settings as Settings,
    Surroundings as Surroundings,
    driver as driver,
    read_settings as read_settings,
)
