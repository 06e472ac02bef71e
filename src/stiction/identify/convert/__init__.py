"""From `joints.json` to the joints of a simulator: text in, text out, no simulator needed."""
