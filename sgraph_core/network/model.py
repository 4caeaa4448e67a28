"""Encoder and head after the paper's equations 1 to 3, in torch-geometric."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch_geometric.nn import GATv2Conv

from sgraph_core.features import EDGE_FEATURES, NODE_FEATURES, FeatureSet

__all__ = ["Encoder", "Head", "PartEncoder", "initialise", "symmetric"]


class EncoderLayer(nn.Module):
    r"""One message-passing layer.

    .. math::
        v_i' = g_v([v_i, \max_j GAT(v_i, e_{ij}, v_j)]), \qquad
        e_{ij}' = g_e([v_i, e_{ij}, v_j])

    (the paper's Eq. 1 and 2). Edge embeddings enter the attention; g_v and g_e are linear layers,
    followed by a ReLU.

    Args:
        node_width: width of v_i.
        edge_width: width of e_ij.
        hidden: width of v_i' and e_ij'.
    """

    def __init__(self, node_width: int, edge_width: int, hidden: int) -> None:
        super().__init__()
        self.attention = GATv2Conv(
            node_width, hidden, edge_dim=edge_width, aggr="max", add_self_loops=False
        )
        self.node_update = nn.Linear(node_width + hidden, hidden)
        self.edge_update = nn.Linear(2 * node_width + edge_width, hidden)

    def forward(self, x: Tensor, edge_index: Tensor, edge_attr: Tensor) -> tuple[Tensor, Tensor]:
        """Return v' [N, hidden] and e' [E, hidden].

        Args:
            x: v, [N, node_width].
            edge_index: j in row 0, i in row 1, [2, E].
            edge_attr: e, [E, edge_width].
        """
        message = self.attention(x, edge_index, edge_attr)
        j, i = edge_index
        edge = self.edge_update(torch.cat([x[i], edge_attr, x[j]], dim=1))
        node = self.node_update(torch.cat([x, message], dim=1))
        return node.relu(), edge.relu()


class Encoder(nn.Module):
    """The encoder that all concepts share: normalisation, then message-passing layers.

    Args:
        hidden: width of the embeddings.
        layers: number of layers.
        features: what it is given of nodes and edges.
    """

    node_mean: Tensor
    node_scale: Tensor
    edge_mean: Tensor
    edge_scale: Tensor

    def __init__(self, hidden: int = 32, layers: int = 2, features: FeatureSet = "support") -> None:
        super().__init__()
        self.hidden = hidden
        nodes, edges = len(NODE_FEATURES[features]), len(EDGE_FEATURES[features])
        self.register_buffer("node_mean", torch.zeros(nodes))
        self.register_buffer("node_scale", torch.ones(nodes))
        self.register_buffer("edge_mean", torch.zeros(edges))
        self.register_buffer("edge_scale", torch.ones(edges))
        widths = [(nodes, edges)] + [(hidden, hidden)] * (layers - 1)
        self.layers = nn.ModuleList(EncoderLayer(v, e, hidden) for v, e in widths)

    def forward(self, x: Tensor, edge_index: Tensor, edge_attr: Tensor) -> tuple[Tensor, Tensor]:
        """Return node embeddings [N, hidden] and edge embeddings [2E, hidden].

        Args:
            x: node features, [N, len(NODE_FEATURES[features])].
            edge_index: j in row 0, i in row 1, [2, 2E].
            edge_attr: edge features, [2E, len(EDGE_FEATURES[features])].
        """
        x, edge_attr = self.normalised(x, edge_attr)
        for layer in self.layers:
            x, edge_attr = layer(x, edge_index, edge_attr)
        return x, edge_attr

    def normalised(self, x: Tensor, edge_attr: Tensor) -> tuple[Tensor, Tensor]:
        """Return features of nodes and edges as the first layer wants them."""
        nodes = (x - self.node_mean) / self.node_scale
        edges = (edge_attr - self.edge_mean) / self.edge_scale
        return nodes, edges


class PartEncoder(nn.Module):
    """An encoder for a part of a scene, around which embeddings are known.

    Args:
        encoder: whose layers are applied.
    """

    def __init__(self, encoder: Encoder) -> None:
        super().__init__()
        self.encoder = encoder

    def forward(
        self, x: Tensor, edge_index: Tensor, edge_attr: Tensor, known: Tensor, before: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return node embeddings after each layer [N, layers * hidden], and edge embeddings.

        Args:
            x: as the encoder takes it, like
            edge_index: and
            edge_attr: of the part.
            known: which nodes' embeddings are known, as they lack neighbours in this part, [N].
            before: theirs after each layer, [N, layers * hidden]; the others' are not looked at.
        """
        x, edge_attr = self.encoder.normalised(x, edge_attr)
        after = []
        before_each = torch.split(before, self.encoder.hidden, dim=1)
        for layer, theirs in zip(self.encoder.layers, before_each, strict=True):
            x, edge_attr = layer(x, edge_index, edge_attr)
            x = torch.where(known[:, None], theirs, x)
            after.append(x)
        return torch.cat(after, dim=1), edge_attr


class Head(nn.Module):
    """The classifier of one relation: three linear layers on [v_i, e_ij, v_j] (the paper's Eq. 3).

    Args:
        width: width of the encoder's embeddings.
        hidden: width of the two hidden layers.
    """

    def __init__(self, width: int = 32, hidden: int = 32) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(3 * width, hidden),
            nn.ReLU(),
            nn.Linear(hidden, hidden),
            nn.ReLU(),
            nn.Linear(hidden, 1),
        )

    def forward(self, x: Tensor, edge_index: Tensor, edge_attr: Tensor) -> Tensor:
        """Return the logits of the directed edges, [2E].

        Args:
            x: node embeddings, [N, width].
            edge_index: j in row 0, i in row 1, [2, 2E].
            edge_attr: edge embeddings, [2E, width].
        """
        j, i = edge_index
        logits: Tensor = self.layers(torch.cat([x[i], edge_attr, x[j]], dim=1))
        return logits.squeeze(1)


def symmetric(logits: Tensor) -> Tensor:
    """Return the logits of the pairs [E]: the mean of both directions' [2E]."""
    forward, backward = logits.chunk(2)
    return (forward + backward) / 2


def initialise(module: nn.Module) -> None:
    """Draw all weight matrices from the Xavier uniform distribution, as the paper does."""
    for parameter in module.parameters():
        if parameter.dim() > 1:
            nn.init.xavier_uniform_(parameter)
        else:
            nn.init.zeros_(parameter)
