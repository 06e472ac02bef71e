"""What every engine must do, measured against exact solutions."""
