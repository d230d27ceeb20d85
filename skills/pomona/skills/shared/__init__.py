"""Parts that several skills share; a skill never imports another."""
