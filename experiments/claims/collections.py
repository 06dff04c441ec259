"""Claims of the experiments on many shapes, pairs and points."""


def full(numbers):
    """Return whether these are the numbers of a full run, whose counts and CPU seconds are claimed too."""
    return not numbers["context"]["smoke"]


def check_throughput(numbers):
    for found in numbers["kinds"].values():
        assert found["gap"] <= 1e-10 and found["difference"] < 1e-13
        assert found["error"]["largest"] > 1e-8 and 1 <= found["steps"]["mean"] <= found["steps"]["most"] < 50
        batches = [entry for rows in found["batches"].values() for entry in rows]
        assert all(entry["seconds"] > 0 for entry in (*batches, *found["loops"].values()))
    if full(numbers) and numbers["platform"] == "cpu":
        for kind, least in (("cubics", 3), ("splines", 2)):
            found = numbers["kinds"][kind]
            gains, inside = (
                {entry["size"]: entry["one by one to this"] for entry in found["batches"][way]}
                for way in ("batch", "batch in the program")
            )
            assert [min(gains), max(gains)] == [1, 1024] and numbers["cores"] >= 2
            assert all(gains[size] > max(least, inside[size]) for size in (256, 1024))
            assert 1e-7 < found["error"]["median"] < 3e-6 and 1e-4 < found["error"]["largest"] < 1e-3


def check_collection_search(numbers):
    for search in numbers["searches"]:
        assert search["agrees"] and search["difference"] < 1e-9 and search["gap"] < 1e-9
        assert search["computed"] < numbers["queries"] * search["shapes"]
    shares = {(search["k"], search["shapes"]): search["share"] for search in numbers["searches"]}
    sizes = sorted({size for _, size in shares})
    for k in (1, 5):
        assert shares[k, sizes[0]] > shares[k, sizes[-1]]
    if full(numbers):
        spent = {search["k"]: search["spent"]["cpu"] for search in numbers["searches"] if search["shapes"] == 2000}
        assert numbers["queries"] == 500 and sizes == [125, 500, 2000]
        assert shares[1, 2000] <= 0.003 and spent[1] < 10 and shares[5, 2000] < 0.01
        assert all(shares[k, 125] > shares[k, 500] > shares[k, 2000] for k in (1, 5))


def check_duplicates(numbers):
    assert numbers["undecided"] == 0 and numbers["grouped"]["agrees"] and numbers["sample"]["agrees"]
    assert 0 < numbers["found"] <= numbers["pairs"] and numbers["computed"] < numbers["pairs"] / 100
    assert max(numbers["grouped"]["distance"]) <= numbers["within"] and max(numbers["upper"]) <= numbers["within"]
    assert numbers["sample"]["near"] > 0
    if full(numbers):
        assert [numbers["shapes"], numbers["pairs"], numbers["found"]] == [11_683, 68_240_403, 905]
        assert numbers["within"] == 0.01 and len(numbers["context"]["parameters"]["FAMILIES"]) == 3
        assert 900 < numbers["computed"] < 1100 and numbers["spent"]["cpu"] < 30 and numbers["sample"]["shapes"] == 120


def check_workers(numbers):
    assert len({entry["bits"] for entry in numbers["entries"] if "bits" in entry}) == 1
    (plain,) = (entry for entry in numbers["entries"] if entry["kind"] == "plain loop")
    others = [entry for entry in numbers["entries"] if entry is not plain]
    assert all(entry["rate"] > 0 for entry in others)
    if full(numbers):
        assert all("bits" in entry for entry in others) and len(others) >= 11
        assert {entry["kind"] for entry in others} >= {"threads", "processes", "Dask", "devices"}
        costs = {(entry["kind"], entry["workers"]): entry["cpu_a_pair"] for entry in others}
        assert all(cost < min(plain["cpu_a_pair"] / 3, 1.3 * costs[kind, 1]) for (kind, _), cost in costs.items())


def check_to_a_million(numbers):
    assert numbers["merged"]["agrees"]
    shards, plan = numbers["shards"], numbers["plan"]
    assert all(shard["within"]["undecided"] == 0 for shard in shards)
    assert shards[0]["nearest"]["share"] > shards[-1]["nearest"]["share"]
    for row in plan.values():
        hours = row["cpu_hours"] / numbers["assumed"]["cores"] / numbers["assumed"]["busy"]
        assert row["tasks"] > 1 and abs(row["hours"] - hours) <= 1e-9 * hours
    assert plan["within"]["hours"] < plan["nearest"]["hours"] < plan["all pairs"]["hours"]
    if full(numbers):
        assert [shard["size"] for shard in shards] == [500, 1000, 2000, 4000] and shards[-1]["nearest"]["share"] < 0.01
        assert numbers["assumed"] == {"shapes": 1_000_000, "cores": 1000, "busy": 0.8}
        assert 72 < plan["all pairs"]["hours"] < 300 and plan["all pairs"]["bytes"] > 1e12
        assert 0.7 < plan["nearest"]["hours"] < 2 and 0.05 < plan["within"]["hours"] < 0.25


def check_scan_to_model(numbers):
    ends = numbers["ends"]
    for found in ends.values():
        assert found["result"] == "successful" and 0 <= found["upper"] - found["lower"] <= 1e-9
        # The distance from points to a few points of the model is larger than to the whole model.
        assert found["lower"] <= found["samples"]["value"] and found["rms"] <= found["upper"]
    assert ends["after"]["rms"] < ends["before"]["rms"] and numbers["steps"][-1] < numbers["steps"][0]
    if full(numbers):
        assert [numbers["points"], numbers["patches"], len(numbers["steps"])] == [94_249, 9, 9]
        noise = numbers["noise"]
        assert abs(ends["after"]["rms"] / noise - 1) < 0.05 and noise < 0.5 * ends["before"]["rms"]
        assert abs(ends["after"]["upper"] / ends["the scanned sheet"]["upper"] - 1) < 0.05
        assert ends["after"]["upper"] < 0.6 * ends["before"]["upper"]
