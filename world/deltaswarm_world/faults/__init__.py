"""What fails in a run: `timeline.py` says when and for whom, the other files what each kind does."""
