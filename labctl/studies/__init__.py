"""What is made of runs: experiments, alignments, comparisons, readouts."""
