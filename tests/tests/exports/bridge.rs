//! The live bridge as a client sees it that is written in Python from the protocol's description alone.

use kingpin_tests::support::{kingpin, peer};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Two clients on a running bench, one of which never reads; what the other got, against the log.
const CLIENT: &str = r#"
import asyncio, json, struct, sys
import websockets
from mcap.reader import make_reader
from mcap_ros2._dynamic import read_message
from mcap_ros2._dynamic import generate_dynamic

url, token, folder = sys.argv[1:4]
PROTOCOLS = ["foxglove.sdk.v1"]
TOPICS = ["/vehicle_state", "/rig_measurement", "/rig_status", "/suspension_state", "/rig_timing"]

async def refused(status, **options):
    try:
        async with websockets.connect(options.pop("url", url), **options):
            raise SystemExit(f"let in: {options}")
    except websockets.exceptions.InvalidStatus as error:
        assert error.response.status_code == status, (options, error)

async def until(socket, accept):
    while True:
        said = await asyncio.wait_for(socket.recv(), 10)
        if isinstance(said, str):
            said = json.loads(said)
            if accept(said):
                return said

def values(said):
    return {p["name"]: p["value"] for p in said["parameters"]}

async def parameters(socket, **asked):
    await socket.send(json.dumps(asked))
    errors = []
    def answer(said):
        if said["op"] == "status" and said["level"] == 2:
            errors.append(said["message"])
        return said["op"] == "parameterValues" and said.get("id") == asked["id"]
    return values(await until(socket, answer)), errors

async def main():
    await refused(403, subprotocols=PROTOCOLS, origin="https://example.org")
    await refused(403, subprotocols=PROTOCOLS, url=url + "/?token=0123456789abcdef")
    port = int(url.rsplit(":", 1)[1])
    await refused(403, subprotocols=PROTOCOLS, url=f"ws://example.org:{port}", host="127.0.0.1", port=port)
    await refused(400, subprotocols=["chat"])
    got = {topic: {} for topic in TOPICS}
    async with websockets.connect(url, subprotocols=PROTOCOLS, max_size=None) as socket, \
            websockets.connect(url, subprotocols=PROTOCOLS, origin="http://localhost:8080") as sleeper:
        assert socket.subprotocol == PROTOCOLS[0]
        info = await until(socket, lambda said: said["op"] == "serverInfo")
        assert "parameters" in info["capabilities"], info
        channels = (await until(socket, lambda said: said["op"] == "advertise"))["channels"]
        by_topic = {channel["topic"]: channel for channel in channels}
        assert all(c["encoding"] == "cdr" and c["schemaEncoding"] == "ros2msg" for c in channels)
        # One that takes everything and reads nothing.
        everything = [{"id": i, "channelId": c["id"]} for i, c in enumerate(channels)]
        await until(socket, lambda said: said["op"] == "status" and "growing_slalom_80" in said["message"])
        sleeper.transport.pause_reading()
        await sleeper.send(json.dumps({"op": "subscribe", "subscriptions": everything}))
        for nonsense in ["", "[]", '{"op":"subscribe","subscriptions":[{"id":1,"channelId":99999}]}', b"\x01abc"]:
            await socket.send(nonsense)
            await until(socket, lambda said: said["op"] == "status" and said["level"] == 2)
        wanted = [{"id": 100 + i, "channelId": by_topic[t]["id"]} for i, t in enumerate(TOPICS)]
        await socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        loop = asyncio.get_running_loop()
        end = loop.time() + 2.5
        while loop.time() < end:
            said = await asyncio.wait_for(socket.recv(), 10)
            if isinstance(said, bytes):
                opcode, number, time = struct.unpack_from("<BIQ", said)
                assert opcode == 1
                got[TOPICS[number - 100]][time] = said[13:]
        await socket.send(json.dumps({"op": "unsubscribe", "subscriptionIds": [w["id"] for w in wanted]}))
        name, value = sys.argv[4], float(sys.argv[5])
        everything, errors = await parameters(socket, op="getParameters", parameterNames=[], id="all")
        assert len(everything) > 10 and not errors, (everything, errors)
        before = everything[name]
        change = [{"name": name, "value": value}]
        after, errors = await parameters(socket, op="setParameters", parameters=change, id="no token")
        assert after == {name: before} and "token" in errors[0], (after, errors)
        async with websockets.connect(f"{url}/?token={token}", subprotocols=PROTOCOLS) as writer:
            await socket.send(json.dumps({"op": "subscribeParameterUpdates", "parameterNames": [name]}))
            await until(socket, lambda said: said["op"] == "parameterValues")
            after, errors = await parameters(writer, op="setParameters", parameters=change, id="set")
            assert after == {name: value} and not errors, (after, errors)
            news = await until(socket, lambda said: said["op"] == "parameterValues")
            assert values(news) == after, news
            for wrong in [{"name": name, "value": 1e9}, {"name": name, "value": [1]}, {"name": "no.such", "value": 1}]:
                same, errors = await parameters(writer, op="setParameters", parameters=[wrong], id="wrong")
                assert errors and same in ({name: after[name]}, {}), (wrong, same, errors)
        try:
            await socket.send("x" * 100_000)
            await until(socket, lambda said: False)
        except websockets.exceptions.ConnectionClosed:
            pass
        sleeper.transport.abort()
    print("taken", {topic: len(messages) for topic, messages in got.items()}, flush=True)
    sys.stdin.readline()  # the run has ended
    logged = {topic: {} for topic in TOPICS}
    with open(folder + "/log.mcap", "rb") as file:
        reader = make_reader(file)
        for schema, channel, message in reader.iter_messages(topics=TOPICS):
            logged[channel.topic][message.log_time] = (schema, message.data)
    fields = 0
    for topic in TOPICS:
        schema = by_topic[topic]["schema"]
        for time, payload in got[topic].items():
            log_schema, data = logged[topic][time]
            assert payload == data, (topic, time)
            assert log_schema.data.decode() == schema
        # The advertised schema decodes it.
        decoded = generate_dynamic(by_topic[topic]["schemaName"], schema)
        message = decoded[by_topic[topic]["schemaName"]](payload)
        fields += len(message.__slots__)
        # Of the ticks between first and last none is missing but those that never were.
        times = sorted(got[topic])
        missed = [t for t in logged[topic] if times[0] < t < times[-1] and t not in got[topic]]
        assert not missed, (topic, len(missed))
        assert len(times) > 1500, (topic, len(times))
    print("equal", sum(map(len, got.values())), "fields", fields)

asyncio.run(main())
"#;

struct Stopped(Child);

impl Drop for Stopped {
    fn drop(&mut self) {
        let _ = Command::new("kill").args(["-TERM", &self.0.id().to_string()]).status();
        let _ = self.0.wait();
    }
}

fn started(arguments: &[&str], folder: &Path) -> Stopped {
    let child = Command::new(kingpin())
        .args(arguments)
        .current_dir(folder)
        .env("KINGPIN_RUNTIME_DIR", folder.join("runtime"))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn();
    Stopped(child.unwrap())
}

#[test]
fn a_foxglove_client_gets_every_tick_as_logged_and_tunes_only_with_the_token() {
    let Some(python) = peer("websockets,mcap,mcap_ros2") else { return };
    let folder = tempfile::tempdir().unwrap();
    let name = format!("bridge-{}", std::process::id());
    let mut bridge = started(&["bridge", "--name", &name, "--port", "0"], folder.path());
    let mut line = String::new();
    BufReader::new(bridge.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let word = |start: &str| line.split_whitespace().find_map(|word| word.strip_prefix(start)).unwrap();
    let address = word("ws://").trim_end_matches('/').to_owned();
    let token = line.rsplit_once("token=").unwrap().1.split_whitespace().next().unwrap().to_owned();
    let run =
        ["run", "growing_slalom_80", "--no-report", "--duration", "12", "--out", "run", "--name", &name];
    let mut run = started(&run, folder.path());
    // Before there is a bench, and while it starts: clients may be there already.
    let (parameter, value) = ("tyre.front.friction_scale", "0.9");
    let mut client = Command::new(python)
        .args(["-c", CLIENT, &format!("ws://{address}"), &token])
        .arg(folder.path().join("run"))
        .args([parameter, value])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let status = run.0.wait().unwrap();
    assert!(status.success(), "{status}");
    drop(client.stdin.take());
    let done = client.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&done.stdout);
    assert!(done.status.success(), "{said}{}", String::from_utf8_lossy(&done.stderr));
    assert!(said.contains("equal"), "{said}");
    println!("{said}");
}
