"""How other simulators read what is made here."""
