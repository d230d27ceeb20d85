"""What `pomona new` writes for skills, nodes and packages; entry points `pomona.new` add more (a word → a `Piece`)."""
