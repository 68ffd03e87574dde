"""What every packer must pass: checks, fuzzing, adversarial scenes."""
