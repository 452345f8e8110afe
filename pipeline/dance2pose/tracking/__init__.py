"""Which of the people of one frame are those of the last: one track a dancer."""
