"""MANO: conversion of its files, reading without running their code, and its layer (Sec. 3.1)."""
