"""A fresh disturber, trained against a policy that does not learn any more."""
