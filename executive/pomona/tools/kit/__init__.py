"""Templates of `pomona new`; entry points `pomona.new` add more (a word → a `Piece`)."""
