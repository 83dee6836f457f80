def main() -> int:
    print("femsub")
    return 0
