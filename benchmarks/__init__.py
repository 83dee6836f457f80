"""What the commands in scripts/ and their tests share: models with known answers, measurements, references. Not installed."""
