"""Runs on disk: folder, history, checkpoint, ParaView."""
