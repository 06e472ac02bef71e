"""`stiction bench`: how much of the simulator's speed the training keeps."""
