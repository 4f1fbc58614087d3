defmodule BB.Handoff.Inlet.Options do
  @moduledoc "The schema of the options that the docs of `BB.Handoff.Inlet` list."
  @moduledoc no_example: "internal: the docs of BB.Handoff.Inlet list the options"

  @schema BB.Options.new!(
            topic: [
              type: {:custom, BB.Topic, :check_declared_found, []},
              required: true,
              doc: "The ring topic, after the robot's topic prefix (`BB.Topic`)."
            ],
            encoding: [
              type: {:behaviour, BB.Handoff.Encoding},
              required: true,
              doc: "The encoding of the messages."
            ],
            to: [
              type: {:list, :atom},
              doc: "The pubsub path; by default the sensor's own, `[:sensor | path]`."
            ],
            credits: [
              type: {:in, 1..1024},
              default: 64,
              doc: """
              Messages that may wait in the inlet's mailbox. Faster ones stay in the ring, and \
              may be lost there.
              """
            ],
            untagged: [
              type: :boolean,
              default: false,
              doc: """
              Whether to accept a topic without a content tag. A message that does not decode is \
              then malformed, and one that decodes by chance is published.
              """
            ]
          )

  @doc "Returns the schema of the options."
  @spec schema() :: BB.Options.t()
  def schema, do: @schema
end
