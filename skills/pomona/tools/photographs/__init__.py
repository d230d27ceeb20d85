"""Fruit in photographs: found, written as files, and judged against labels; folders of labelled photographs."""
