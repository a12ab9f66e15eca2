"""A local web page for hands: photographs, landmarks, the webcam, and the sources of knowledge one by one."""
