"""Speech on fingers: reading, coding, levels and limits in dB SL, what is felt of it, and playing."""
