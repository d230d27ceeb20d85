"""A cell: devices behind drivers, one clock and one safe stop, as a cell file describes them."""
