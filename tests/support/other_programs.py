"""What other programs make of a recording of ours. `has PACKAGE..` ends with 0 where all are there; `mcap FILE` prints JSON."""

import collections
import importlib
import json
import sys


def has(names):
    for name in names:
        importlib.import_module(name)


def checked(rules, content):
    """What does not fit a JSON Schema, which must itself be one."""
    try:
        import jsonschema
    except ImportError:
        return []
    jsonschema.Draft202012Validator.check_schema(rules)
    return [error.message for error in jsonschema.Draft202012Validator(rules).iter_errors(content)]


def read_mcap(path):
    """All messages, with every checksum looked at and decoded by the schemas in the file."""
    from google.protobuf.unknown_fields import UnknownFieldSet
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    said = collections.defaultdict(lambda: {"count": 0, "misfits": [], "fields": []})
    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        notes = {record.name: record.metadata for record in reader.iter_metadata()}
        for schema, channel, message in reader.iter_messages():
            topic = said[channel.topic]
            topic["count"] += 1
            topic["schema"] = schema.name
            topic["encoding"] = channel.message_encoding
            if channel.message_encoding == "json":
                topic["misfits"] += checked(json.loads(schema.data), json.loads(message.data))
        for schema, channel, message, value in reader.iter_decoded_messages(topics=protobuf(said)):
            topic = said[channel.topic]
            topic["fields"] = sorted(field.name for field, _ in value.ListFields())
            if len(UnknownFieldSet(value)) > 0:
                topic["misfits"].append("a field that its schema does not know")
            if value.timestamp.ToNanoseconds() != message.log_time:
                topic["misfits"].append("its time is not that of the log")
    print(json.dumps({"topics": said, "notes": notes}))


def protobuf(said):
    return [name for name, topic in said.items() if topic["encoding"] == "protobuf"]


if __name__ == "__main__":
    verb, *rest = sys.argv[1:]
    has(rest) if verb == "has" else read_mcap(*rest)
