"""How high a policy climbs, without and with joint friction."""
