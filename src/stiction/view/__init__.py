"""The browser viewer: policies that walk side by side, while somebody turns their joints' friction up."""
